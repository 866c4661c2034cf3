//! Linear pixel shuffling: a progressive low-discrepancy order of the pixels. (To be filled in.)
