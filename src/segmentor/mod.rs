//! The SEGMENTOR of the framework: one window in, labels out.
//!
//! A segmentor sees the points of one window and nothing else: no other window, no segment ids, no other segmentor.
//! Adding one is one file here and one line in this list.

mod dbscan;
mod exactness;
mod proximity;

pub use dbscan::Dbscan;
pub use exactness::{Assessment, Exactness};
pub use proximity::{Graph, Proximity};

use crate::error::Result;
use crate::label::Labels;
use crate::window::Window;

/// Labels the points of one window.
pub trait Segmentor: Send + Sync {
    /// Short name, as in messages and manifests.
    fn name(&self) -> &str;

    /// Under which condition the streamed partition equals the static one.
    fn exactness(&self) -> Exactness;

    /// Whether several windows may be segmented at the same time.
    fn is_concurrent(&self) -> bool {
        true
    }

    /// One label for each of [`Window::points`].
    ///
    /// # Errors
    /// If the window cannot be segmented.
    fn segment(&self, window: &Window) -> Result<Labels>;
}
