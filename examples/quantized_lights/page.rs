//! x
pub(crate) fn assembled(p: &[(&str, String)]) -> String {
    format!("{p:?}")
}
