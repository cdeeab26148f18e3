//! Lossy coding, and the ledger of its errors.

pub mod blocks;
pub mod ledger;
pub mod prediction;
pub mod row_blocks;
pub mod rows;
