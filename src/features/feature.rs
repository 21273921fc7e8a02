//! What can be computed for a point, by name.

use crate::attribute::is_same_name;

/// One number per point that is computed from its neighbors.
///
/// The neighborhood includes the point itself. λ₁ ≥ λ₂ ≥ λ₃ are the eigenvalues of the covariance of the neighbors'
/// positions, with their number as divisor. A feature has no value (NaN) with fewer than three neighbors; more on that
/// with each.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Feature {
    /// x of the unit normal of the plane through the neighbors, which points upward: z > 0, else y > 0, else x > 0. No
    /// value where the neighbors lie on a line or at one place.
    NormalX,
    /// y of the unit normal.
    NormalY,
    /// z of the unit normal.
    NormalZ,
    /// Standard deviation √(Σv²/(n − 3)) of the distances v from the plane, in units of the coordinates; 0 for n = 3. No
    /// value where the normal has none.
    NormalSigma0,
    /// λ₁, in squared units of the coordinates.
    NormalEigenvalue1,
    /// λ₂.
    NormalEigenvalue2,
    /// λ₃.
    NormalEigenvalue3,
    /// (λ₁ − λ₂)/λ₁. This and the next five have no value where all neighbors are at one place.
    Linearity,
    /// (λ₂ − λ₃)/λ₁.
    Planarity,
    /// λ₃/λ₁.
    Sphericity,
    /// ∛(λ₁ λ₂ λ₃), in squared units of the coordinates.
    Omnivariance,
    /// (λ₁ − λ₃)/λ₁.
    Anisotropy,
    /// −Σ eᵢ ln eᵢ with eᵢ = λᵢ/Σλ: 0 on a line, ln 3 where all directions are alike.
    Eigenentropy,
    /// λ₃/Σλ; 0 where all neighbors are at one place.
    SurfaceVariation,
    /// 1 − |z of the normal|. No value where the normal has none.
    Verticality,
    /// Number of neighbors, the point itself included; always has a value.
    NeighborCount,
    /// H, the mean of the two principal curvatures, per unit of the coordinates; positive where the surface bends toward
    /// its upward normal, as a bowl does. This and the next three need six neighbors that do not all lie on a conic.
    MeanCurvature,
    /// K, the product of the principal curvatures, per squared unit of the coordinates.
    GaussianCurvature,
    /// H + √(H² − K), the greater principal curvature.
    MaxCurvature,
    /// H − √(H² − K), the smaller principal curvature.
    MinCurvature,
}

impl Feature {
    /// All features.
    pub const ALL: [Feature; 20] = [
        Feature::NormalX,
        Feature::NormalY,
        Feature::NormalZ,
        Feature::NormalSigma0,
        Feature::NormalEigenvalue1,
        Feature::NormalEigenvalue2,
        Feature::NormalEigenvalue3,
        Feature::Linearity,
        Feature::Planarity,
        Feature::Sphericity,
        Feature::Omnivariance,
        Feature::Anisotropy,
        Feature::Eigenentropy,
        Feature::SurfaceVariation,
        Feature::Verticality,
        Feature::NeighborCount,
        Feature::MeanCurvature,
        Feature::GaussianCurvature,
        Feature::MaxCurvature,
        Feature::MinCurvature,
    ];

    /// The feature of this name, whatever its case and underscores.
    pub fn by_name(name: &str) -> Option<Feature> {
        Self::ALL.into_iter().find(|feature| is_same_name(feature.name(), name))
    }

    /// Its name as users read it.
    pub fn name(self) -> &'static str {
        match self {
            Feature::NormalX => "NormalX",
            Feature::NormalY => "NormalY",
            Feature::NormalZ => "NormalZ",
            Feature::NormalSigma0 => "NormalSigma0",
            Feature::NormalEigenvalue1 => "NormalEigenvalue1",
            Feature::NormalEigenvalue2 => "NormalEigenvalue2",
            Feature::NormalEigenvalue3 => "NormalEigenvalue3",
            Feature::Linearity => "Linearity",
            Feature::Planarity => "Planarity",
            Feature::Sphericity => "Sphericity",
            Feature::Omnivariance => "Omnivariance",
            Feature::Anisotropy => "Anisotropy",
            Feature::Eigenentropy => "Eigenentropy",
            Feature::SurfaceVariation => "SurfaceVariation",
            Feature::Verticality => "Verticality",
            Feature::NeighborCount => "NeighborCount",
            Feature::MeanCurvature => "MeanCurvature",
            Feature::GaussianCurvature => "GaussianCurvature",
            Feature::MaxCurvature => "MaxCurvature",
            Feature::MinCurvature => "MinCurvature",
        }
    }

    /// Whether it comes from the quadric.
    pub(super) fn is_curvature(self) -> bool {
        use Feature::{GaussianCurvature, MaxCurvature, MeanCurvature, MinCurvature};
        matches!(self, MeanCurvature | GaussianCurvature | MaxCurvature | MinCurvature)
    }
}
