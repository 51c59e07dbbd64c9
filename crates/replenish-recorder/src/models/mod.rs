//! Every interleaving of the ring, by `loom`: `RUSTFLAGS="--cfg loom" cargo test --release -p
//! replenish-recorder --lib loom_`.

mod loom_ring;
