//! What goes out: documents to their keys, answers to questions.

use super::State;
use crate::{
    service::{AskedDocument, BacklogPart, Command, Event, FitEnd, outbox::Outbox},
    telemetry::sets::{QueryAnswered, QueryOutcome},
};

/// Questions that may wait for an answer at one time.
const QUESTIONS_MAX: usize = 256;

impl State {
    pub(super) fn take_publication(&mut self, now_ns: i64, event: Event, out: &mut Outbox) {
        match event {
            Event::Published {
                kind,
                site,
                version,
            } => {
                let address = (kind, site, version);
                self.publishing.published(now_ns, &address, out);
            }
            Event::PublicationMarked {
                kind,
                site,
                version,
            } => self.publishing.marked(&(kind, site, version)),
            Event::PublicationFailed {
                kind,
                site,
                version,
                failure,
            } => {
                let address = (kind, site, version);
                self.publishing
                    .failed(now_ns, &address, failure, &self.options, out);
            }
            Event::DocumentAsked {
                question,
                selector,
                asked,
            } => self.answer(question, selector, asked, out),
            Event::QuestionAnswered { selector, outcome } => {
                self.questions = self.questions.saturating_sub(1);
                out.report(QueryAnswered { selector, outcome });
            }
            _ => {}
        }
    }

    /// Something is to be put on its key.
    pub(super) fn load_unpublished(&mut self, out: &mut Outbox) {
        self.documents_loading += 1;
        out.push(Command::LoadBacklog(BacklogPart::Unpublished));
    }

    /// A fit or a diagnosis ended. One that is kept once more is published as a new one is.
    pub(super) fn fit_ended(&mut self, now_ns: i64, job: i64, end: FitEnd, out: &mut Outbox) {
        let repeated = matches!(end, FitEnd::DiagnosedBefore { .. });
        self.fits.fit_ended(now_ns, job, end, &self.options, out);
        if repeated {
            self.load_unpublished(out);
        }
    }

    fn answer(
        &mut self,
        question: u64,
        selector: String,
        asked: Result<AskedDocument, String>,
        out: &mut Outbox,
    ) {
        let refusal = match asked {
            Ok(asked) if self.questions < QUESTIONS_MAX => {
                self.questions += 1;
                out.push(Command::Answer { question, asked });
                return;
            }
            Ok(_) => (
                "too many questions at one time".to_owned(),
                QueryOutcome::Failed,
            ),
            Err(reason) => (reason, QueryOutcome::Malformed),
        };
        let (reason, outcome) = refusal;
        out.push(Command::Refuse { question, reason });
        out.report(QueryAnswered { selector, outcome });
    }
}
