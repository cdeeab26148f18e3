//! Transport of the smooth far part: balanced tree over the samples, weighted Haar details, hierarchical integration.
