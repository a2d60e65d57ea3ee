//! Reads what a client goes on to send after it was refused, so that it gets to see why.
//!
//! A client that is still sending when the connection closes loses the answer: the rest of its body
//! meets a closed socket, and the reset that follows discards what it had not read yet. Browsers send
//! all before they read.

use std::{
    pin::Pin,
    sync::{
        Arc, Mutex, PoisonError,
        atomic::{AtomicBool, Ordering},
    },
    task::{Context, Poll},
    time::Duration,
};

use axum::{
    body::{Body, Bytes, HttpBody},
    extract::Request,
    http::header,
    middleware::Next,
    response::Response,
};
use http_body::{Frame, SizeHint};

/// Bytes read and dropped after an answer at most: sixteen times the largest form. Who sends more
/// is cut off.
const BYTES_MAX: u64 = 256 * 1024 * 1024;
/// Longest time for it.
const TIME_MAX: Duration = Duration::from_secs(10);

/// Answers, once the request's body was read to its end or to a bound.
pub(super) async fn drained(request: Request, next: Next) -> Response {
    if request.body().is_end_stream() {
        return next.run(request).await;
    }
    let (parts, body) = request.into_parts();
    let waits_for_a_word = parts.headers.contains_key(header::EXPECT);
    let body = Shared(Arc::new(Kept {
        body: Mutex::new(body),
        touched: AtomicBool::new(false),
    }));
    let rest = body.clone();
    let response = next.run(Request::from_parts(parts, Body::new(body))).await;
    // Whoever asked first (`Expect: 100-continue`) and was not told to go on has sent nothing.
    if !waits_for_a_word || rest.0.touched.load(Ordering::Relaxed) {
        // What was not read by then is cut off with the connection.
        tokio::time::timeout(TIME_MAX, rest.drop_all()).await.ok();
    }
    response
}

/// A body that outlives whoever reads it.
#[derive(Clone, Debug)]
struct Shared(Arc<Kept>);

#[derive(Debug)]
struct Kept {
    body: Mutex<Body>,
    touched: AtomicBool,
}

impl Shared {
    async fn drop_all(mut self) {
        let mut read = 0;
        while read < BYTES_MAX {
            let frame = std::future::poll_fn(|context| Pin::new(&mut self).poll_frame(context));
            match frame.await {
                Some(Ok(frame)) => read += frame.data_ref().map_or(0, |data| data.len() as u64),
                Some(Err(_)) | None => return,
            }
        }
    }
}

impl HttpBody for Shared {
    type Data = Bytes;
    type Error = axum::Error;

    fn poll_frame(
        self: Pin<&mut Self>,
        context: &mut Context<'_>,
    ) -> Poll<Option<Result<Frame<Bytes>, axum::Error>>> {
        self.0.touched.store(true, Ordering::Relaxed);
        let mut body = self.0.body.lock().unwrap_or_else(PoisonError::into_inner);
        Pin::new(&mut *body).poll_frame(context)
    }

    fn is_end_stream(&self) -> bool {
        let body = self.0.body.lock().unwrap_or_else(PoisonError::into_inner);
        body.is_end_stream()
    }

    fn size_hint(&self) -> SizeHint {
        let body = self.0.body.lock().unwrap_or_else(PoisonError::into_inner);
        body.size_hint()
    }
}
