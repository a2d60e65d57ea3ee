//! load_model.
