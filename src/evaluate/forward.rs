//! Evaluators that wrap another one.

/// Forwards the calls that do not concern light to the evaluator that is wrapped in a field.
macro_rules! forward_scene {
    ($inner:ident) => {
        fn capabilities(&self) -> $crate::evaluate::Capabilities {
            self.$inner.capabilities()
        }

        fn cost(&self) -> $crate::evaluate::Cost {
            self.$inner.cost()
        }

        fn scene(&self) -> &$crate::scene::Scene {
            self.$inner.scene()
        }

        fn bvh(&self) -> &$crate::geometry::bvh::Bvh {
            self.$inner.bvh()
        }

        fn measured_error(
            &mut self,
            unseen: &[$crate::light::Light],
            progress: &dyn $crate::progress::Progress,
        ) -> $crate::error::Result<$crate::compress::ledger::Ledger> {
            self.$inner.measured_error(unseen, progress)
        }
    };
}
pub(crate) use forward_scene;

/// Forwards the calls that an evaluator on a device leaves to the processor: those of single scattering, and all pairs.
#[cfg(feature = "gpu")]
macro_rules! forward_to_processor {
    ($inner:ident) => {
        fn all_pairs(&mut self, progress: &dyn $crate::progress::Progress) -> $crate::error::Result<Vec<glam::DVec3>> {
            self.$inner.all_pairs(progress)
        }

        fn single_scattering(
            &mut self,
            progress: &dyn $crate::progress::Progress,
        ) -> $crate::error::Result<Option<Vec<glam::DVec3>>> {
            self.$inner.single_scattering(progress)
        }

        fn single_scattering_is(&self) -> $crate::evaluate::SingleScattering {
            self.$inner.single_scattering_is()
        }

        fn towards_eye(
            &self,
        ) -> $crate::error::Result<Option<Box<dyn $crate::evaluate::single_scattering::TowardsEye + '_>>> {
            self.$inner.towards_eye()
        }
    };
}
#[cfg(feature = "gpu")]
pub(crate) use forward_to_processor;
