//! Visibility of a whole cube map from a point, decided for groups of directions at once.
