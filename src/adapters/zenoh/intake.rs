//! The way from zenoh's receiving threads to ours: bounded queues that never make zenoh wait.
//!
//! A subscriber's callback runs on the thread that receives from the network. It copies the
//! payload into a queue and returns; when the queue is full, the message is dropped and counted.

use std::{
    borrow::Cow,
    sync::{
        Arc,
        atomic::{AtomicU64, AtomicUsize, Ordering},
        mpsc::{Receiver, SyncSender, sync_channel},
    },
};

use super::{Address, Question};

/// A message as it came from the network.
#[derive(Debug)]
pub enum Message {
    /// A payload on a measurement or recording key.
    Payload {
        /// What the key says.
        address: Address,
        /// The encoding that the sender declared, such as `application/cbor`.
        encoding: Cow<'static, str>,
        /// The bytes.
        payload: Vec<u8>,
        /// When it came, UTC nanoseconds.
        arrived_ns: i64,
        /// Its share of the bytes that may wait; set by the queue.
        held: Option<Held>,
    },
    /// A message on a key of no documented form.
    Stray {
        /// The key.
        key: String,
    },
    /// A question that is answered when everything before it in this queue has been taken in.
    Barrier(Question),
    /// Nothing comes after this.
    End,
}

/// Bytes of a message that waits; given back when the message is dropped.
#[derive(Debug)]
pub struct Held {
    bytes: usize,
    of: Arc<AtomicUsize>,
}

impl Drop for Held {
    fn drop(&mut self) {
        self.of.fetch_sub(self.bytes, Ordering::Relaxed);
    }
}

/// How many messages were dropped since the last look.
#[derive(Debug, Default)]
pub struct Drops {
    /// Sample batches.
    pub measurements: AtomicU64,
    /// Recordings.
    pub recordings: AtomicU64,
    /// Questions.
    pub questions: AtomicU64,
}

impl Drops {
    /// The counts of measurements, recordings and questions since the last call.
    pub fn take(&self) -> [u64; 3] {
        [&self.measurements, &self.recordings, &self.questions]
            .map(|count| count.swap(0, Ordering::Relaxed))
    }
}

/// The entrance of the queues.
#[derive(Clone, Debug)]
pub struct Entrance {
    pub(super) measurements: SyncSender<Message>,
    pub(super) recordings: SyncSender<Message>,
    pub(super) questions: SyncSender<Question>,
    pub(super) drops: Arc<Drops>,
    pub(super) now_ns: fn() -> i64,
    /// Of the batches that wait.
    waiting_bytes: Arc<AtomicUsize>,
}

/// The exits of the queues.
#[derive(Debug)]
pub struct Exits {
    /// Sample batches and barriers between them.
    pub measurements: Receiver<Message>,
    /// Recordings and barriers between them.
    pub recordings: Receiver<Message>,
    /// Questions for parameter sets and for the status.
    pub questions: Receiver<Question>,
    /// What the bounds cost.
    pub drops: Arc<Drops>,
}

/// Bytes of sample batches that wait for their decoder: a batch may hold megabytes, and their number alone bounds
/// nothing. Chosen: 40 s of the frames of a thousand streams.
const BATCH_BYTES_MAX: usize = 128 << 20;
/// Recordings that wait for their decoder; each may hold many megabytes.
const RECORDINGS_MAX: usize = 32;
/// Questions that wait for an answer.
const QUESTIONS_MAX: usize = 256;

/// Queues that hold at most `messages_max` sample batches; `now_ns` says when they arrive.
#[must_use]
pub fn queues(messages_max: usize, now_ns: fn() -> i64) -> (Entrance, Exits) {
    let (measurements, measurements_exit) = sync_channel(messages_max);
    let (recordings, recordings_exit) = sync_channel(RECORDINGS_MAX);
    let (questions, questions_exit) = sync_channel(QUESTIONS_MAX);
    let drops = Arc::new(Drops::default());
    let entrance = Entrance {
        measurements,
        recordings,
        questions,
        drops: Arc::clone(&drops),
        now_ns,
        waiting_bytes: Arc::default(),
    };
    let exits = Exits {
        measurements: measurements_exit,
        recordings: recordings_exit,
        questions: questions_exit,
        drops,
    };
    (entrance, exits)
}

impl Entrance {
    /// Marks the end of both queues, behind everything that waits in them. Blocks while they are
    /// full; does nothing when nobody reads them any more.
    pub fn end(&self) {
        for queue in [&self.measurements, &self.recordings] {
            queue.send(Message::End).ok();
        }
    }

    pub(super) fn measurement(&self, mut message: Message) {
        let mut has_room = true;
        if let Message::Payload { payload, held, .. } = &mut message {
            *held = self.hold(payload.len());
            has_room = held.is_some();
        }
        if !has_room || self.measurements.try_send(message).is_err() {
            self.drops.measurements.fetch_add(1, Ordering::Relaxed);
        }
    }

    fn hold(&self, bytes: usize) -> Option<Held> {
        let before = self.waiting_bytes.fetch_add(bytes, Ordering::Relaxed);
        let held = Held {
            bytes,
            of: Arc::clone(&self.waiting_bytes),
        };
        (before.saturating_add(bytes) <= BATCH_BYTES_MAX).then_some(held)
    }

    pub(super) fn recording(&self, message: Message) {
        if self.recordings.try_send(message).is_err() {
            self.drops.recordings.fetch_add(1, Ordering::Relaxed);
        }
    }

    pub(super) fn question(&self, question: Question) {
        if self.questions.try_send(question).is_err() {
            self.drops.questions.fetch_add(1, Ordering::Relaxed);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_full_queue_drops_and_counts() {
        let (entrance, exits) = queues(1, || 0);
        for _ in 0..3 {
            entrance.measurement(Message::Stray {
                key: "k".to_owned(),
            });
        }
        assert_eq!(exits.drops.take(), [2, 0, 0]);
        assert_eq!(exits.drops.take(), [0, 0, 0]);
        assert_eq!(exits.measurements.try_iter().count(), 1);
    }

    #[test]
    fn few_large_messages_fill_the_queue_as_well() {
        let (entrance, exits) = queues(100, || 0);
        let put = |bytes: usize| {
            entrance.measurement(Message::Payload {
                address: Address::Measurement {
                    site: "north".to_owned(),
                    stream: "pmu".to_owned(),
                },
                encoding: "".into(),
                payload: vec![0; bytes],
                arrived_ns: 0,
                held: None,
            });
        };
        put(BATCH_BYTES_MAX - 10);
        put(11);
        put(10);
        assert_eq!(exits.drops.take(), [1, 0, 0]);
        assert_eq!(exits.measurements.try_iter().count(), 2);
        // Taken out, they hold nothing any more.
        put(BATCH_BYTES_MAX);
        assert_eq!(exits.drops.take(), [0, 0, 0]);
    }
}
