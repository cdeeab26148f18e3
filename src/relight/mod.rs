//! Relighting in real time: a window, and the same frames without one. Knows evaluators by their traits only.
