//! Files that users write or edit, and recordings, as they may be: damaged, or with slips.

mod damage;
mod keys;
