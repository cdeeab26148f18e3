//! A basis of the far parts of R_d over the materials that an asset allows, by principal components.
