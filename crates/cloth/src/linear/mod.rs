//! Linear algebra for matrices whose pattern never changes.
//!
//! [`Cholesky`] factors sparse matrices. Unknowns that are at places in space are ordered by nested
//! dissection, others by faer's approximate minimum degree. The symbolic factorisation is faer's; the
//! numeric part is a multifrontal factorisation of our own (Liu 1992), because the fronts of a cloth
//! of some hundred nodes have 5 to 60 rows, where a kernel without set-up cost is several times
//! faster. [`multiply`] is a dense product.

mod analysis;
mod cholesky;
mod dense;
mod factor;
mod numbers;
mod order;
mod points;
mod simd;
mod solve;
mod threads;
mod tree;

pub use cholesky::Cholesky;
pub use dense::multiply;
pub use threads::Threads;
