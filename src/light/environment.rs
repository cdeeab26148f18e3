//! .
/// .
#[derive(Clone, Debug)]
pub struct EnvironmentMap {}
