//! What goes out over zenoh, in the order in which the core gave it.

use tokio::{
    sync::mpsc::{UnboundedReceiver, UnboundedSender},
    task::JoinHandle,
};

use crate::{
    adapters::{wire::v1::encode_event_summary, zenoh::LinkPublisher},
    service::{Command, DocumentKind, Event, Failure},
};

/// Publishes until the sender is dropped. The queue is as long as the core's own bounds admit.
pub(super) fn spawn(
    link: LinkPublisher,
    mut commands: UnboundedReceiver<Command>,
    events: UnboundedSender<Event>,
) -> JoinHandle<()> {
    tokio::spawn(async move {
        while let Some(command) = commands.recv().await {
            if let Some(event) = carry_out(&link, command).await
                && events.send(event).is_err()
            {
                return;
            }
        }
    })
}

async fn carry_out(link: &LinkPublisher, command: Command) -> Option<Event> {
    match command {
        Command::Publish(pending) => {
            let (kind, site, version) = (pending.kind, pending.site, pending.version);
            let put = match kind {
                DocumentKind::Set => link.put_set(&site, pending.document).await,
                DocumentKind::Diagnosis => link.put_diagnosis(&site, pending.document).await,
            };
            Some(match put {
                Ok(()) => Event::Published {
                    kind,
                    site,
                    version,
                },
                Err(error) => Event::PublicationFailed {
                    kind,
                    site,
                    version,
                    failure: failure(&error),
                },
            })
        }
        Command::Announce { window, screening } => {
            let id = window.id.clone();
            let document = match encode_event_summary(&window, Some(&screening)) {
                Ok(document) => document,
                Err(error) => {
                    return Some(Event::WindowStepFailed {
                        window: id,
                        failure: failure(&error),
                    });
                }
            };
            Some(match link.put_event(&window.site, document).await {
                Ok(()) => Event::EventAnnounced { window: id },
                Err(error) => Event::WindowStepFailed {
                    window: id,
                    failure: failure(&error),
                },
            })
        }
        _ => None,
    }
}

fn failure(error: &impl std::error::Error) -> Failure {
    Failure {
        reason: "publication",
        error: error.to_string(),
        passing: true,
    }
}
