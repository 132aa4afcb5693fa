//! The adaptive controllers: one file each, in the notation of the thesis.

pub mod l1;
