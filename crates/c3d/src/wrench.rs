//! Converts plate channels to the reaction on the subject, N and N·m about the origin of the file's
//! world.
//!
//! Each plate type is first converted to force and moment about a reference point in plate axes.
//! Then sign and moment unit are checked against the properties of a loaded plate (an upward
//! reaction, a centre of pressure on the plate) and repaired with a warning. Finally the wrench is
//! rotated into world axes and moved to the world origin.
//!
//! Sources: The C3D File Format, User Guide (FORCE_PLATFORM); Kistler's formulae for eight-channel
//! plates (type 3).

use nalgebra::{Matrix3, Vector3};

use crate::{
    C3dError, C3dFile, PlateDescription, PlateWrench, Warning, WarningKind, plate_reader::channels_of_kind, unit,
};

/// Vertical force below which a plate gives no evidence for sign or units, N.
const LOADED_N: f64 = 20.0;
/// Mean vertical force up to which a baseline is accepted as the plate's own offset, N.
const RESTING_N: f64 = 60.0;

/// Position and axes of a plate in the file's world, lengths in the file's point units.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PlateFrame {
    /// Columns: plate x, y, z in world axes. Orthonormal, right-handed.
    pub world_from_plate: Matrix3<f64>,
    /// Centre of the surface.
    pub centre: Vector3<f64>,
    /// Half the size along plate x and y.
    pub half_size: [f64; 2],
}

impl PlateDescription {
    /// The plate's frame from its corners, which are stored in the order (+x +y), (−x +y), (−x −y),
    /// (+x −y) of the plate's own axes. `None` if they do not span a rectangle or are not finite.
    pub fn frame(&self) -> Option<PlateFrame> {
        let [a, b, c, d] = self.corners.map(Vector3::from);
        let along_x = (a + d - b - c) / 2.0;
        let along_y = (a + b - c - d) / 2.0;
        let x = along_x.try_normalize(1e-12)?;
        let z = along_x.cross(&along_y).try_normalize(1e-12)?;
        let y = z.cross(&x);
        let sizes = [along_x.norm(), along_y.norm()];
        // Collinear corners have a non-zero cross product because of rounding errors.
        let spans = along_x.cross(&along_y).norm() > 1e-3 * sizes[0] * sizes[1];
        let finite = sizes.iter().all(|s| s.is_finite());
        (spans && finite).then(|| PlateFrame {
            world_from_plate: Matrix3::from_columns(&[x, y, z]),
            centre: (a + b + c + d) / 4.0,
            half_size: sizes.map(|s| s / 2.0),
        })
    }
}

/// Force and moment in plate axes, sample by sample, SI.
struct InPlate {
    force_n: Vec<Vector3<f64>>,
    /// About `reference`.
    moment_nm: Vec<Vector3<f64>>,
    /// Reference point from the centre of the surface, plate axes, m.
    reference_m: Vector3<f64>,
    /// Whether the moments' unit comes from a statement that can be wrong.
    unit_doubtful: bool,
}

impl C3dFile {
    /// The calibrated wrench of plate `index` as reaction on the subject, one entry for each analog
    /// sample.
    ///
    /// Types 1 to 4 as described by the format; type 5 is its 6 × 8 calibration matrix times the
    /// eight channels. A baseline range in FORCE_PLATFORM:ZERO is subtracted if it lies inside the
    /// recording and the plate is unloaded there. The sign is such that a loaded plate pushes up:
    /// the world axis nearest to the plate's normal is taken as vertical, positive towards the side
    /// with the markers or, without markers, according to POINT:Y_SCREEN.
    ///
    /// # Errors
    /// [`C3dError::NoPlate`]; [`C3dError::Plate`] for types 6 and 7, missing channels, corners that
    /// do not span a rectangle.
    pub fn plate_wrench(&self, index: usize) -> Result<PlateWrench, C3dError> {
        let plate = self.plates.get(index).ok_or(C3dError::NoPlate { index, count: self.plates.len() })?;
        let fail = |problem: String| C3dError::Plate { index, problem };
        let mut warnings = Vec::new();
        let mut warn = |message: String| {
            warnings.push(Warning::new(WarningKind::Plates, format!("plate {}: {message}", index + 1)));
        };
        let frame = plate.frame().ok_or_else(|| fail(format!("corners {:?} span no plate", plate.corners)))?;
        let metres = self.metres_per_point_unit().unwrap_or_else(|| {
            warn(format!("POINT:UNITS `{}` is not a length; taken as mm", self.point_unit));
            1e-3
        });
        let wanted = channels_of_kind(plate.kind);
        if !matches!(plate.kind, 1..=5) {
            return Err(fail(format!("type {} is not calibrated (types 1 to 5 are)", plate.kind)));
        }
        if plate.channels.len() < wanted || plate.channels.iter().any(|c| *c >= self.analogs.len()) {
            return Err(fail(format!(
                "type {} needs {wanted} channels of {}, FORCE_PLATFORM:CHANNEL gives {:?}",
                plate.kind,
                self.analogs.len(),
                plate.channels.iter().map(|c| c + 1).collect::<Vec<_>>()
            )));
        }

        let up = up_axis(self, &frame, metres, &mut warn);
        let up_in_plate = frame.world_from_plate.transpose() * up;
        let mut origin_m = Vector3::from(plate.origin) * metres;
        if !origin_m.iter().all(|x| x.is_finite()) {
            return Err(fail(format!("origin {:?}", plate.origin)));
        }
        // The vector from the sensor to the surface points up; some files store the opposite
        // direction.
        let rise = origin_m.z * up_in_plate.z;
        if plate.kind != 1 && rise < 0.0 {
            warn(format!("ORIGIN z {} puts the sensor above the surface; its sign was turned", plate.origin[2]));
            if plate.kind == 3 { origin_m.z = -origin_m.z } else { origin_m = -origin_m }
        }

        let baseline = self.baseline(plate, up_in_plate, &mut warn);
        let mut inside = self.in_plate_axes(plate, origin_m, metres, &baseline, &mut warn);
        settle_moment_unit(&mut inside, &frame, metres, up_in_plate, &mut warn);
        let sign = reaction_sign(&inside.force_n, up_in_plate, &mut warn);

        let rotation = frame.world_from_plate;
        let reference_in_world = frame.centre * metres + rotation * inside.reference_m;
        let mut force_n = Vec::with_capacity(inside.force_n.len());
        let mut moment_nm = Vec::with_capacity(inside.force_n.len());
        for (force, moment) in inside.force_n.iter().zip(&inside.moment_nm) {
            let force_in_world = rotation * force * sign;
            let moment_in_world = rotation * moment * sign + reference_in_world.cross(&force_in_world);
            force_n.push(force_in_world.into());
            moment_nm.push(moment_in_world.into());
        }
        Ok(PlateWrench { force_n, moment_nm, warnings })
    }

    /// Mean of each channel over the unloaded frames given by FORCE_PLATFORM:ZERO; zeros if it
    /// gives none that are usable.
    fn baseline(&self, plate: &PlateDescription, up_in_plate: Vector3<f64>, warn: &mut impl FnMut(String)) -> Vec<f64> {
        let none = vec![0.0; plate.channels.len()];
        let [first, last] = plate.zero_frames.map(i64::from);
        if last <= 0 {
            return none;
        }
        let start = i64::from(self.first_frame);
        let end = start + self.n_frames as i64 - 1;
        if first < start || last < first || last > end {
            warn(format!("ZERO {first} to {last} is not in frames {start} to {end}; no baseline taken off"));
            return none;
        }
        let per_frame = self.samples_per_frame();
        let range = (first - start) as usize * per_frame..(last - start + 1) as usize * per_frame;
        let mean = |channel: usize| {
            let values = self.analogs[channel].values.get(range.clone()).unwrap_or_default();
            values.iter().sum::<f64>() / values.len().max(1) as f64
        };
        let means: Vec<f64> = plate.channels.iter().map(|c| mean(*c)).collect();
        let weights = vertical_weights(plate, up_in_plate);
        let resting: f64 = weights.iter().zip(&means).map(|(w, m)| w * m).sum();
        let samples = plate.channels.iter().map(|c| self.analogs[*c].values.len()).min().unwrap_or(0);
        let (mut low, mut high) = (resting, resting);
        for i in 0..samples {
            let vertical: f64 = weights.iter().zip(&plate.channels).map(|(w, c)| w * self.analogs[*c].values[i]).sum();
            low = low.min(vertical);
            high = high.max(vertical);
        }
        if !means.iter().all(|m| m.is_finite()) || !is_offset(resting, low, high) {
            warn(format!(
                "ZERO {first} to {last}: the plate is loaded there ({:.0} N); no baseline taken off",
                resting.abs()
            ));
            return none;
        }
        means
    }

    /// Force and moment in plate axes from the channels.
    fn in_plate_axes(
        &self,
        plate: &PlateDescription,
        origin_m: Vector3<f64>,
        metres: f64,
        baseline: &[f64],
        warn: &mut impl FnMut(String),
    ) -> InPlate {
        let channels: Vec<&[f64]> = plate.channels.iter().map(|c| self.analogs[*c].values.as_slice()).collect();
        let samples = channels.iter().map(|c| c.len()).min().unwrap_or(0);
        let unit_of = |k: usize| self.analogs[plate.channels[k]].unit.as_str();
        let newtons = unit::newtons(unit_of(0)).unwrap_or(1.0);
        let raw = |k: usize, i: usize| channels[k][i] - baseline[k];
        let mut force_n = Vec::with_capacity(samples);
        let mut moment_nm = Vec::with_capacity(samples);
        let (mut reference_m, mut unit_doubtful) = (-origin_m, false);
        match plate.kind {
            1 => {
                // Three forces, centre of pressure on the surface, free moment.
                reference_m = Vector3::zeros();
                let length = unit::metres_per(unit_of(3)).unwrap_or(metres);
                let torque = unit::newton_metres(unit_of(5)).unwrap_or(newtons * metres);
                for i in 0..samples {
                    let force = Vector3::new(raw(0, i), raw(1, i), raw(2, i)) * newtons;
                    // The centre of pressure is a position, not a signal with a tare.
                    let pressure = Vector3::new(channels[3][i], channels[4][i], 0.0) * length;
                    force_n.push(force);
                    moment_nm.push(pressure.cross(&force) + Vector3::new(0.0, 0.0, raw(5, i) * torque));
                }
            }
            3 => {
                // Four corner sensors; ORIGIN contains their distances from the centre and their
                // depth.
                reference_m = Vector3::new(0.0, 0.0, -origin_m.z);
                let (a, b) = (origin_m.x.abs(), origin_m.y.abs());
                for i in 0..samples {
                    let [x12, x34, y14, y23, z1, z2, z3, z4] = std::array::from_fn(|k| raw(k, i) * newtons);
                    force_n.push(Vector3::new(x12 + x34, y14 + y23, z1 + z2 + z3 + z4));
                    moment_nm.push(Vector3::new(
                        b * (z1 + z2 - z3 - z4),
                        a * (z2 + z3 - z1 - z4),
                        b * (x34 - x12) + a * (y14 - y23),
                    ));
                }
            }
            _ => {
                unit_doubtful = true;
                let stated = unit::newton_metres(unit_of(3));
                let torque = stated.unwrap_or_else(|| {
                    warn(format!(
                        "unit of the moments `{}` is no moment; taken as N times {}",
                        unit_of(3),
                        self.point_unit
                    ));
                    newtons * metres
                });
                let matrix = if plate.kind == 2 { Vec::new() } else { output_rows(plate, warn) };
                let mut input = vec![0.0; plate.channels.len()];
                for i in 0..samples {
                    for (k, value) in input.iter_mut().enumerate() {
                        *value = raw(k, i);
                    }
                    let out = apply(&matrix, &input);
                    force_n.push(Vector3::new(out[0], out[1], out[2]) * newtons);
                    moment_nm.push(Vector3::new(out[3], out[4], out[5]) * torque);
                }
            }
        }
        InPlate { force_n, moment_nm, reference_m, unit_doubtful }
    }
}

/// The world axis nearest to the plate's normal, pointing up, that is towards the side of the plate
/// with the markers. POINT:Y_SCREEN, which some programs write wrongly, is used only if the markers
/// are inconclusive.
fn up_axis(file: &C3dFile, frame: &PlateFrame, metres: f64, warn: &mut impl FnMut(String)) -> Vector3<f64> {
    let normal = frame.world_from_plate.column(2).into_owned();
    let axis = normal.iamax();
    let screen = file.groups.get("POINT", "Y_SCREEN").and_then(|p| p.string()).unwrap_or_default();
    let stated_down = screen.eq_ignore_ascii_case(["-X", "-Y", "-Z"][axis]);
    let down = match markers_above(file, frame, axis, metres) {
        Some(above) => {
            if above == stated_down {
                let found = if above { "+" } else { "-" };
                warn(format!(
                    "POINT:Y_SCREEN `{screen}` contradicts the markers, which are on the {found}{} side of the plate; the markers count",
                    ["X", "Y", "Z"][axis]
                ));
            }
            !above
        }
        // the axes of a screen say nothing certain: Qualisys writes `-Z` into recordings that are
        // Z-up
        None => {
            if stated_down {
                warn(format!(
                    "POINT:Y_SCREEN `{screen}` is not taken as the vertical; no marker says which side is up"
                ));
            }
            false
        }
    };
    let mut up = Vector3::zeros();
    up[axis] = if down { -1.0 } else { 1.0 };
    up
}

/// Whether the markers are on the positive side of the plate along a world axis; `None` if
/// inconclusive.
fn markers_above(file: &C3dFile, frame: &PlateFrame, axis: usize, metres: f64) -> Option<bool> {
    /// The markers of a subject extend farther from the plate than this, m.
    const CLEAR_M: f64 = 0.2;
    /// Number of frames examined.
    const FRAMES: usize = 50;
    let step = (file.n_frames / FRAMES).max(1);
    let mut heights: Vec<f64> = file
        .points
        .iter()
        .flat_map(|p| p.xyz.iter().step_by(step))
        .map(|xyz| (f64::from(xyz[axis]) - frame.centre[axis]) * metres)
        .filter(|h| h.is_finite())
        .collect();
    if heights.is_empty() {
        return None;
    }
    let middle = heights.len() / 2;
    let median = *heights.select_nth_unstable_by(middle, f64::total_cmp).1;
    (median.abs() > CLEAR_M).then_some(median > 0.0)
}

/// Whether the vertical force of a baseline can be the plate's own offset, given the range over the
/// recording. A small one can; a large one only if the load extends from it to one side and through
/// zero, because a plate is never pulled.
fn is_offset(resting: f64, low: f64, high: f64) -> bool {
    let largest = low.abs().max(high.abs());
    if resting.abs() <= RESTING_N.max(0.15 * largest) {
        return true;
    }
    let (up, down) = (high - resting, resting - low);
    let (reach, other, extreme) = if up > down { (up, down, high) } else { (down, up, low) };
    other <= LOADED_N.max(0.1 * reach) && extreme * resting < 0.0 && extreme.abs() > 0.3 * resting.abs()
}

/// Contribution of each channel to the vertical force, in the channels' unit.
fn vertical_weights(plate: &PlateDescription, up_in_plate: Vector3<f64>) -> Vec<f64> {
    let up = [up_in_plate.x, up_in_plate.y, up_in_plate.z];
    let axes: &[usize] = if plate.kind == 3 { &[0, 0, 1, 1, 2, 2, 2, 2] } else { &[0, 1, 2] };
    let rows = if plate.kind >= 4 { output_rows(plate, &mut |_| {}) } else { Vec::new() };
    (0..plate.channels.len())
        .map(|k| match rows.get(..3) {
            Some(rows) => (0..3).map(|r| up[r] * rows[r].get(k).copied().unwrap_or(0.0)).sum(),
            None => axes.get(k).map_or(0.0, |axis| up[*axis]),
        })
        .collect()
}

/// The calibration as six rows; empty if there is none to apply.
fn output_rows(plate: &PlateDescription, warn: &mut impl FnMut(String)) -> Vec<Vec<f64>> {
    let (inputs, rows) = (channels_of_kind(plate.kind), &plate.calibration);
    let usable = rows.iter().flatten().all(|x| x.is_finite()) && rows.iter().flatten().any(|x| *x != 0.0);
    if usable && rows.len() >= 6 && rows.iter().all(|r| r.len() >= inputs) {
        return rows[..6].to_vec();
    }
    if usable && rows.len() >= inputs && rows.iter().all(|r| r.len() >= 6) {
        return (0..6).map(|out| (0..inputs).map(|k| rows[k][out]).collect()).collect();
    }
    warn("no usable CAL_MATRIX; its channels were taken as forces and moments".to_owned());
    Vec::new()
}

fn apply(matrix: &[Vec<f64>], input: &[f64]) -> [f64; 6] {
    if matrix.is_empty() {
        return std::array::from_fn(|k| input.get(k).copied().unwrap_or(0.0));
    }
    std::array::from_fn(|r| matrix[r].iter().zip(input).map(|(m, x)| m * x).sum())
}

/// Checks the moments' unit with the centre of pressure, which is on the plate while the plate is
/// loaded, and repairs a factor of a thousand (the conversion from N·m to N·mm applied in both or
/// in neither of CAL_MATRIX and UNITS).
fn settle_moment_unit(
    inside: &mut InPlate,
    frame: &PlateFrame,
    metres: f64,
    up_in_plate: Vector3<f64>,
    warn: &mut impl FnMut(String),
) {
    if !inside.unit_doubtful {
        return;
    }
    let half = frame.half_size.map(|s| s * metres);
    let diagonal = half[0].hypot(half[1]);
    let largest =
        inside.force_n.iter().map(|f| f.dot(&up_in_plate).abs()).filter(|f| f.is_finite()).fold(0.0, f64::max);
    let threshold = LOADED_N.max(0.25 * largest);
    // Fraction of loaded samples with the centre of pressure on the plate, and its spread relative
    // to the plate's size.
    let seen = |factor: f64| -> Option<(f64, f64)> {
        let (mut loaded, mut on, mut squares) = (0_usize, 0_usize, 0.0);
        for (force, moment) in inside.force_n.iter().zip(&inside.moment_nm) {
            if force.dot(&up_in_plate).abs() < threshold || !moment.iter().all(|m| m.is_finite()) {
                continue;
            }
            // At the surface, from the moment about its centre.
            let m = moment * factor + inside.reference_m.cross(force);
            let (x, y) = (-m.y / force.z, m.x / force.z);
            loaded += 1;
            on += usize::from(x.abs() <= 1.1 * half[0] && y.abs() <= 1.1 * half[1]);
            squares += x * x + y * y;
        }
        (loaded >= 10).then(|| (on as f64 / loaded as f64, (squares / loaded as f64).sqrt() / diagonal))
    };
    let Some((on, spread)) = seen(1.0) else { return };
    if on >= 0.5 && spread > 0.005 {
        return;
    }
    for factor in [1e-3, 1e3] {
        if seen(factor).is_some_and(|(on, spread)| on >= 0.9 && spread > 0.005) {
            warn(format!(
                "moments as stated put the centre of pressure off the plate or all in one point; taken times {factor}"
            ));
            inside.moment_nm.iter_mut().for_each(|m| *m *= factor);
            return;
        }
    }
    if on < 0.5 {
        warn(format!("the centre of pressure is off the plate in {:.0} % of loaded samples", 100.0 * (1.0 - on)));
    }
}

/// +1, or −1 if the channels contain the load on the plate instead of the reaction.
fn reaction_sign(forces: &[Vector3<f64>], up_in_plate: Vector3<f64>, warn: &mut impl FnMut(String)) -> f64 {
    let vertical = || forces.iter().map(|f| f.dot(&up_in_plate)).filter(|f| f.is_finite());
    let largest = vertical().fold(0.0, |m: f64, f| m.max(f.abs()));
    if largest < LOADED_N {
        return 1.0;
    }
    // Half of the largest value excludes an offset that was not subtracted.
    let threshold = LOADED_N.max(0.5 * largest);
    let sum: f64 = vertical().filter(|f| f.abs() >= threshold).sum();
    if sum < 0.0 {
        warn("the channels hold the load on the plate; turned into the reaction on the subject".to_owned());
        -1.0
    } else {
        1.0
    }
}
