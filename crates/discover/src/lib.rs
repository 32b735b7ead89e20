//! Which effect is missing, how sure, and what it can be confused with
