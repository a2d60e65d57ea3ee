//! estimates.
