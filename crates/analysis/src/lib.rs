//! Computations behind the commands other than `run`. Results are plain data, which the binary
//! renders.

pub mod assess;
pub mod audit;
pub mod check;
pub mod compare;
mod contradiction;
pub mod corrections;
pub mod discover;
pub mod effect;
pub mod estimators;
pub mod export;
pub mod freshness;
pub mod held_out;
pub mod history;
pub mod init;
pub mod inspect;
pub mod inspect_values;
mod laboratories;
pub mod markerset;
pub mod notes;
pub mod own_laws;
pub mod parameters;
pub mod promise;
mod results;
pub mod session_check;
pub mod simulate;
pub mod status;
mod stored_columns;
pub mod summary;
pub mod switch_kernel;
mod switch_rows;
pub mod switches;
pub mod unknowns;
pub mod verdict;
pub mod verify;
pub mod visible;
pub mod workflow;
