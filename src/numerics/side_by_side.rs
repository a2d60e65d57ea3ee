//! Several tasks that ask one objective, in step with one another.
//!
//! A task is an algorithm written as if it were alone; where it asks the objective it waits. Once every
//! task waits (or has ended), their questions are answered together, which an objective that evaluates
//! points side by side does at the price of a few. Nothing here knows of time or threads: a round follows
//! a round, and what a task sees does not depend on the others.

use std::{
    cell::RefCell,
    pin::{Pin, pin},
    task::{Context, Poll, Waker},
};

use nalgebra::DVector;
use rayon::prelude::*;

use super::{
    Cost, Expansion, Objective,
    objective::{Counted, finite_expansion},
};

/// Points of a round that are evaluated by one thread.
const POINTS_TOGETHER: usize = 64;
/// The same for points with derivatives.
const EXPANSIONS_TOGETHER: usize = 16;

/// What an algorithm asks of an objective; answers are finite or none.
pub(super) trait Ask {
    /// The objective.
    async fn value(&mut self, x: &DVector<f64>) -> Option<f64>;
    /// The objective at several points.
    async fn values(&mut self, points: &[DVector<f64>]) -> Vec<Option<f64>>;
    /// The objective with its derivatives.
    async fn expansion(&mut self, x: &DVector<f64>) -> Option<Expansion>;
    /// What the questions and steps cost so far.
    fn cost(&mut self) -> &mut Cost;
}

/// Asked directly, an objective answers at once.
impl Ask for Counted<'_> {
    async fn value(&mut self, x: &DVector<f64>) -> Option<f64> {
        Counted::value(self, x)
    }

    async fn values(&mut self, points: &[DVector<f64>]) -> Vec<Option<f64>> {
        Counted::values(self, points)
    }

    async fn expansion(&mut self, x: &DVector<f64>) -> Option<Expansion> {
        Counted::expansion(self, x)
    }

    fn cost(&mut self) -> &mut Cost {
        &mut self.cost
    }
}

/// The outcome of a task that waits for nothing: one that asks an objective directly.
#[allow(clippy::panic, reason = "an objective asked directly answers at once")]
pub(super) fn at_once<T>(task: impl Future<Output = T>) -> T {
    match pin!(task).poll(&mut Context::from_waker(Waker::noop())) {
        Poll::Ready(outcome) => outcome,
        Poll::Pending => panic!("an objective asked directly answers at once"),
    }
}

/// What a task has written down for the next round, or what it was answered.
#[derive(Default)]
enum Note {
    #[default]
    Nothing,
    Values(Vec<DVector<f64>>),
    AnsweredValues(Vec<Option<f64>>),
    Expansion(DVector<f64>),
    AnsweredExpansion(Option<Expansion>),
}

/// A task's own way to ask.
pub(super) struct Asking<'n> {
    note: &'n RefCell<Note>,
    cost: Cost,
}

impl Asking<'_> {
    /// Writes the question down and waits until `answer` finds the note answered.
    async fn ask<T>(&self, question: Note, answer: impl Fn(Note) -> Result<T, Note>) -> T {
        self.note.replace(question);
        std::future::poll_fn(|_| match answer(self.note.take()) {
            Ok(answer) => Poll::Ready(answer),
            Err(question) => {
                self.note.replace(question);
                Poll::Pending
            }
        })
        .await
    }
}

impl Ask for Asking<'_> {
    async fn value(&mut self, x: &DVector<f64>) -> Option<f64> {
        self.values(std::slice::from_ref(x)).await.pop().flatten()
    }

    async fn values(&mut self, points: &[DVector<f64>]) -> Vec<Option<f64>> {
        self.cost.values += points.len() as u64;
        self.ask(Note::Values(points.to_vec()), |note| match note {
            Note::AnsweredValues(values) => Ok(values),
            question => Err(question),
        })
        .await
    }

    async fn expansion(&mut self, x: &DVector<f64>) -> Option<Expansion> {
        self.cost.expansions += 1;
        self.ask(Note::Expansion(x.clone()), |note| match note {
            Note::AnsweredExpansion(expansion) => Ok(expansion),
            question => Err(question),
        })
        .await
    }

    fn cost(&mut self) -> &mut Cost {
        &mut self.cost
    }
}

/// Runs `task` for the numbers below `count` in step and returns their outcomes in order.
pub(super) fn run<T>(
    objective: &dyn Objective,
    count: usize,
    task: &impl for<'n> AsyncFn(usize, Asking<'n>) -> T,
) -> Vec<T> {
    let notes: Vec<RefCell<Note>> = (0..count).map(|_| RefCell::default()).collect();
    let mut outcomes: Vec<Option<T>> = (0..count).map(|_| None).collect();
    let mut tasks: Vec<Pin<Box<dyn Future<Output = T> + '_>>> = Vec::with_capacity(count);
    for (number, note) in notes.iter().enumerate() {
        let asking = Asking {
            note,
            cost: Cost::default(),
        };
        tasks.push(Box::pin(task(number, asking)));
    }
    let mut context = Context::from_waker(Waker::noop());
    loop {
        for (outcome, task) in outcomes.iter_mut().zip(&mut tasks) {
            if outcome.is_none()
                && let Poll::Ready(end) = task.as_mut().poll(&mut context)
            {
                *outcome = Some(end);
            }
        }
        if outcomes.iter().all(Option::is_some) {
            return outcomes.into_iter().flatten().collect();
        }
        // Values first: the tasks on a path catch up with those that wait for derivatives.
        if !answer_values(objective, &notes) {
            answer_expansions(objective, &notes);
        }
    }
}

/// Answers all questions for values; whether there were any.
fn answer_values(objective: &dyn Objective, notes: &[RefCell<Note>]) -> bool {
    let mut points = Vec::new();
    let mut asked = Vec::new();
    for note in notes {
        match note.take() {
            Note::Values(some) => {
                asked.push((note, some.len()));
                points.extend(some);
            }
            other => drop(note.replace(other)),
        }
    }
    let mut values = (points.par_chunks(POINTS_TOGETHER))
        .flat_map_iter(|points| objective.values(points))
        .map(|value| value.filter(|value| value.is_finite()))
        .collect::<Vec<_>>()
        .into_iter();
    for (note, count) in &asked {
        note.replace(Note::AnsweredValues(values.by_ref().take(*count).collect()));
    }
    !asked.is_empty()
}

fn answer_expansions(objective: &dyn Objective, notes: &[RefCell<Note>]) {
    let mut points = Vec::new();
    let mut asked = Vec::new();
    for note in notes {
        match note.take() {
            Note::Expansion(x) => {
                asked.push(note);
                points.push(x);
            }
            other => drop(note.replace(other)),
        }
    }
    let expansions: Vec<_> = (points.par_chunks(EXPANSIONS_TOGETHER))
        .flat_map_iter(|points| objective.expansions(points))
        .collect();
    for (note, expansion) in asked.into_iter().zip(expansions) {
        note.replace(Note::AnsweredExpansion(finite_expansion(expansion)));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::numerics::test_functions::HIMMELBLAU;

    #[test]
    fn every_task_is_answered_what_it_asked_whatever_the_others_ask() {
        let task = async |number: usize, mut asking: Asking<'_>| {
            let at = |i: usize| DVector::from_element(2, (number * 10 + i) as f64);
            let mut sum = 0.0;
            for i in 0..number {
                let values = asking.values(&[at(i), at(i + 1)]).await;
                sum += values.into_iter().flatten().sum::<f64>();
                if i % 2 == 0 {
                    sum += asking
                        .expansion(&at(i))
                        .await
                        .map_or(0.0, |e| e.gradient[0]);
                }
            }
            (sum, *asking.cost())
        };
        let together = run(&HIMMELBLAU, 7, &task);
        for (number, (sum, cost)) in together.into_iter().enumerate() {
            let (mut alone, mut counted) = (0.0, Counted::new(&HIMMELBLAU));
            let at = |i: usize| DVector::from_element(2, (number * 10 + i) as f64);
            for i in 0..number {
                alone += [at(i), at(i + 1)]
                    .iter()
                    .filter_map(|x| counted.value(x))
                    .sum::<f64>();
                if i % 2 == 0 {
                    alone += counted.expansion(&at(i)).map_or(0.0, |e| e.gradient[0]);
                }
            }
            assert_eq!((sum.to_bits(), cost), (alone.to_bits(), counted.cost));
        }
    }
}
