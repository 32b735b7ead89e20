//! When no external force acts
