//! Landmarks and anthropometry to a person's own model
