//! How wrong a fill is: one model, learned from measured pixels that were predicted without themselves.
//!
//! A held-out sample shows the error of a method where the truth is known ([`Evidence`]). It stands in an emptier place than a
//! missing pixel does, so its error is too large, by 1 to 8 dB at masks of low discrepancy. How empty a place is, the mask alone
//! says, as a variance `v` ([`Kind`](crate::descriptor::Kind)); error follows it as a power, with a factor that depends on the place ([`Model`]):
//!
//! ```text
//! e(x)^2 = c(x) v(x)^p        c: sums of m e^2 and m v^p over held-out samples around x, m what each counts for
//!                             p: from samples that were held out twice, with few and with half of the others
//! ```
//!
//! `p` is 1.2 to 2 where shading is smooth, about 0.6 where edges decide, 0 where noise does; it stays within 0 and 1.75. Where errors are
//! as large as the samples' own differences, the power levels off before the first depth, and `p` is raised by up to 0.15.
//!
//! Where samples lie evenly, how the error falls from held-out samples to missing pixels is also simulated, for every method alike: the filled frame
//! is reduced until its details are as fine beside the spacing of the samples as those of the frame, and filled by the same method, with and
//! without samples held out ([`Simulation`]). The logarithms of what both say are averaged, each by the inverse of its variance: that of the
//! exponent times how far missing pixels lie from held-out samples in `ln v`, that of chance in the smaller image, and 0.22 squared for either. Where
//! they are apart, the interval is wider. What they say together scales the errors of single pixels, too.
//!
//! From it follow the root mean square error of the missing pixels with an interval that holds the truth nine times of ten
//! ([`Model::verdict`], [`Verdict`]), and a plane of estimated errors, calibrated on the same samples ([`Model::plane`]). The interval is made of
//! what few cells carry (as a bootstrap of cells would find it), of what errors larger than those seen would add if the largest follow a power law
//! (B. M. Hill, 1975), of the variance of law and simulation, and of a rest. Where it passes 6 dB to a side, its upper end is all that is told
//! ([`Verdict::AtMost`]). A frame whose error few cells carry, or whose interval goes beyond the range of its samples, gets
//! [`Verdict::CannotTell`]. Where none of `n` held-out samples errs, three of as many might: the bound is the range times the root of `3 / n`.
//!
//! Held-out samples come from [`Evidence::of_folds`], for any method; of large frames that `auto` fills by one candidate, from tiles and the
//! leave-one-out errors of splines (`auto/alone.rs`), the variance of whose ratio widens the interval. [`Folds`] are drawn by a seed; all that learns from a frame
//! uses the same.
//!
//! Cost: a fill without a tenth of the samples (up to ten of them where there are few) and one without half of them, of large frames in tiles that
//! are spread over it ([`Excerpt`](crate::excerpt::Excerpt)); two of a smaller image (a quarter of the pixels or less, 384 x 384 at most), or after rounds four rounds once more (of colours) and a fill, of frames beyond 2.1 million pixels in sixteen windows; the four nearest samples of each held-out one and of 40000 missing pixels.
//! The plane: the nearest samples of every missing pixel, and four blurs. Memory: six planes.
//!
//! Samples that stand close together must not speak for all of the image. Where samples lie unevenly, `m` is the root of the number of missing
//! pixels that a sample is the nearest of (by the number itself those at the rim of a dense place count too little); elsewhere it is 1.
//! Where errors are larger in dense places than in others, samples were put where errors are, in a second pass or in rounds: then each
//! held-out sample speaks for the missing pixels that it is the nearest of, with `e^2 (v' / v)^(s p)`, `v'` the variance of such a pixel, and
//! the interval is wider. The share `s` falls from 1 to that of the exponent the more unevenly samples lie: 0.25 for `p` up to 1.15, 0.8 for the largest.
//! It was chosen on renders of four blobs, `head`, foot and chest (480 x 360 pixels, 5, 10 and 20 % in rounds), with one share of 0.45 before:
//! smooth shading was then 2.6 dB too bad there (1.6 dB on seven other scenes), edges 0.5 to 0.7 dB too good (0.6 to 1.2 dB). How fast it
//! falls was chosen on crops of five other renders, after a second pass; how much wider the interval is, and what unseen errors count for, on the
//! same scenes as the share. Samples that were put where errors are bound nothing that none of them has met, as thin vessels between those of
//! the first round: where the interval would be a bound, nothing is told.
//!
//! Where samples were put where errors are, held-out samples do not show what the rounds passed over. So rounds are repeated on the filled frame
//! ([`Repetition`]; other groups than colours take over what these chose), and what the repetition misses is the least that is told: without it thin vessels were told 6 dB too good after rounds, and 10 dB
//! where guides filled them.
//!
//! Fails: details that no sample has seen anywhere; a method whose error at a sample is not that beside it (one that smooths its samples). Noise that grows
//! like detail by chance: at masks of low discrepancy estimates of path-traced frames are up to 2.6 dB too good.
//!
//! Sources: B. Efron, "Bootstrap methods: another look at the jackknife", The Annals of Statistics 7, 1979; N. Cressie, "Statistics for
//! Spatial Data", 1993 (kriging variance); E. H. Isaaks, R. M. Srivastava, "An Introduction to Applied Geostatistics", 1989, chapter 10
//! (declustering); M. Stone, "Cross-Validatory Choice and Assessment of Statistical Predictions", Journal of the Royal Statistical Society
//! B 36, 1974.

mod evidence;
pub(crate) mod held_out;
mod kriging;
mod lattice;
mod memory;
mod model;
mod near;
mod plane;
mod repetition;
mod simulation;
mod variance;
mod voronoi;

pub use evidence::Evidence;
pub use held_out::{Fold, Folds, HELD_OUT, HeldOut, PARTS};
pub use memory::{REPEATED, holes, may_repeat};
pub use model::{Model, Rmse, Verdict, Why};
pub use repetition::{Repeated, Repetition, Rounds};
pub use simulation::Simulation;
pub(crate) use voronoi::Voronoi;
