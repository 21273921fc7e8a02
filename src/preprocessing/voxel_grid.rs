//! Voxel grid: one point for all that lie in the same cube.
//!
//! Source: PCL's `VoxelGrid`, whose lattice is anchored at absolute zero too: voxel = floor(coordinate / size).
//! Departures: numbers of voxels are 64-bit, so that no cloud is too large for them; sums are taken from the corner of a
//! voxel's points, so that no digit is lost; attributes are those of the real point nearest to the centroid, not averages,
//! because the average of two classes is no class.
//!
//! A voxel is final if its square on the map has been loaded. Where the size is a whole number of lattice steps no rounding
//! decides in which voxel a point lies.

use super::{Preprocessed, Stage};
use crate::error::{Error, Result, positive};
use crate::lattice::{Lattice, whole_steps};
use crate::window::Window;

/// Which point stands for the points of a voxel.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Representative {
    /// Their mean. Its point id is the smallest of theirs.
    #[default]
    Centroid,
    /// The one nearest to their mean; of equally near ones that with the smallest point id.
    Nearest,
}

impl std::str::FromStr for Representative {
    type Err = Error;

    fn from_str(text: &str) -> Result<Self> {
        match text {
            "centroid" => Ok(Representative::Centroid),
            "nearest" => Ok(Representative::Nearest),
            _ => Err(Error::parameter("representative", format!("'{text}'"), "'centroid' or 'nearest'")),
        }
    }
}

impl Representative {
    /// Its name for people.
    pub fn name(self) -> &'static str {
        match self {
            Representative::Centroid => "centroid",
            Representative::Nearest => "nearest",
        }
    }
}

/// Thins a cloud to one point per voxel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct VoxelGrid {
    size: f64,
    representative: Representative,
}

impl VoxelGrid {
    /// Voxels with edges of length `size`, in units of the coordinates.
    ///
    /// # Errors
    /// If the size is not a finite number above 0.
    pub fn new(size: f64, representative: Representative) -> Result<Self> {
        Ok(Self { size: positive("size", size)?, representative })
    }

    /// The length of an edge, in units of the coordinates.
    pub fn size(&self) -> f64 {
        self.size
    }

    /// Which point stands for a voxel's points.
    pub fn representative(&self) -> Representative {
        self.representative
    }

    /// The points of the window, voxel by voxel, in order of point id.
    fn sorted(&self, window: &Window, voxels: &Voxels) -> Result<Vec<Member>> {
        let members =
            (0..).zip(window.points().iter().zip(window.point_ids())).map(|(position, (point, &point_id))| {
                let voxel = voxels.of(point).ok_or_else(|| self.too_small(window, point))?;
                Ok(Member { voxel, point_id, position })
            });
        let mut members = members.collect::<Result<Vec<Member>>>()?;
        members.sort_unstable();
        Ok(members)
    }

    #[cold]
    fn too_small(&self, window: &Window, point: &[f64; 3]) -> Error {
        let given = format!("{}, with a point at {:?}", self.size, window.lattice().real(point));
        Error::parameter("size", given, "a length that leaves fewer than 9e15 voxels between a point and zero")
    }
}

impl Stage for VoxelGrid {
    fn name(&self) -> &'static str {
        "voxel grid"
    }

    /// A voxel's diagonal to the point that stands for it, one more around any voxel that a later step looks at from there,
    /// and something for rounding.
    fn halo(&self) -> f64 {
        3.0 * self.size
    }

    fn displacement(&self) -> f64 {
        3f64.sqrt() * self.size
    }

    fn apply(&self, window: &Window) -> Result<Preprocessed> {
        let voxels = Voxels::new(self.size, window.lattice());
        let members = self.sorted(window, &voxels)?;
        let (mut successors, mut undecided) = (vec![None; window.points().len()], vec![]);
        let (mut positions, mut point_ids, mut nearest) = (vec![], vec![], vec![]);
        for members in members.chunk_by(|a, b| a.voxel == b.voxel) {
            if !voxels.corners(members[0].voxel).iter().all(|corner| window.holds(corner, 0.0)) {
                undecided.extend(members.iter().map(|member| member.position));
                continue;
            }
            for member in members {
                successors[member.position as usize] = Some(positions.len() as u32);
            }
            let center = center(members, window.points());
            let member = nearest_to(&center, members, window);
            nearest.push(member.position);
            match self.representative {
                Representative::Centroid => {
                    positions.push(window.lattice().real(&center));
                    point_ids.push(members[0].point_id);
                }
                Representative::Nearest => {
                    positions.push(window.points()[member.position as usize]);
                    point_ids.push(member.point_id);
                }
            }
        }
        let lattice = match self.representative {
            Representative::Centroid => Lattice::REAL,
            Representative::Nearest => *window.lattice(),
        };
        let mut window = window.replaced(positions, point_ids, lattice, window.columns().select(&nearest));
        // The diagonal of a voxel: nearer to the border not all voxels are there.
        window.shrink(1.5 * self.size);
        undecided.sort_unstable();
        Ok(Preprocessed { window, successors, undecided })
    }
}

/// A point and the voxel it lies in.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct Member {
    voxel: [i64; 3],
    point_id: i64,
    position: u32,
}

/// The mean of points, in lattice coordinates. Their distances from the corner of them all are whole numbers on a lattice,
/// so their sum is exact.
fn center(members: &[Member], points: &[[f64; 3]]) -> [f64; 3] {
    std::array::from_fn(|axis| {
        let along = || members.iter().map(|member| points[member.position as usize][axis]);
        let corner = along().fold(f64::INFINITY, f64::min);
        corner + along().map(|c| c - corner).sum::<f64>() / members.len() as f64
    })
}

fn nearest_to<'a>(center: &[f64; 3], members: &'a [Member], window: &Window) -> &'a Member {
    let scale = window.lattice().scale();
    let squared = |member: &Member| {
        let point = window.points()[member.position as usize];
        let [x, y, z] = std::array::from_fn(|axis| (point[axis] - center[axis]) * scale[axis]);
        x * x + y * y + z * z
    };
    let mut best = (f64::INFINITY, &members[0]);
    for member in members {
        let squared = squared(member);
        if squared < best.0 {
            best = (squared, member);
        }
    }
    best.1
}

/// Numbers of voxels beyond this would not be exact.
const MOST_VOXELS: f64 = 9e15;

/// The voxels of a size, counted from absolute zero.
struct Voxels {
    axes: [Axis; 3],
}

/// How coordinates along an axis become numbers of voxels: floor((coordinate · weight + zero) / size).
struct Axis {
    weight: f64,
    zero: f64,
    size: f64,
}

impl Voxels {
    fn new(size: f64, lattice: &Lattice) -> Self {
        let axes = std::array::from_fn(|k| {
            let (scale, offset) = (lattice.scale()[k], lattice.offset()[k]);
            match (whole_steps(size, scale), whole_steps(offset, scale)) {
                // In steps, so that there is no rounding.
                (Some(size), Some(zero)) if lattice.is_whole() && size > 0.0 => Axis { weight: 1.0, zero, size },
                _ => Axis { weight: scale, zero: offset, size },
            }
        });
        Self { axes }
    }

    /// The voxel of a point; none if it is too far from zero.
    fn of(&self, point: &[f64; 3]) -> Option<[i64; 3]> {
        let mut voxel = [0; 3];
        for ((number, axis), coordinate) in voxel.iter_mut().zip(&self.axes).zip(point) {
            let place = ((coordinate * axis.weight + axis.zero) / axis.size).floor();
            if place.abs() >= MOST_VOXELS {
                return None;
            }
            *number = place as i64;
        }
        Some(voxel)
    }

    /// The corners of a voxel's square on the map, in lattice coordinates.
    fn corners(&self, [x, y, _]: [i64; 3]) -> [[f64; 3]; 4] {
        let border = |axis: &Axis, number: i64| (number as f64 * axis.size - axis.zero) / axis.weight;
        [(0, 0), (0, 1), (1, 0), (1, 1)]
            .map(|(right, up)| [border(&self.axes[0], x + right), border(&self.axes[1], y + up), 0.0])
    }
}
