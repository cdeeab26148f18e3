//! What is lost on the way, and the record of it.

pub mod blocks;
pub mod ledger;
pub mod prediction;
pub mod row_blocks;
pub mod rows;
