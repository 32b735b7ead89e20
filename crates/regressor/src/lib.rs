//! Rows and factors: what one flight says about the parameters
