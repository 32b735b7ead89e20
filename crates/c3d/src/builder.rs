//! Creates new files: points, channels, plates, events, custom parameters.

use nalgebra::Vector3;

use crate::{
    Analog, ByteOrder, C3dError, C3dFile, FileEvent, HeaderEvent, Parameter, Parameters, PlateDescription, PlateWrench,
    Point, PointKind, SegmentPoses, Storage, parameter_sync, unit,
};

/// Builds a [`C3dFile`] step by step. The defaults are Intel byte order, floats and mm.
///
/// ```
/// use aloft_c3d::{C3dBuilder, C3dFile};
///
/// let file = C3dBuilder::new(200.0)
///     .marker("LASI", vec![[1.0, 2.0, 3.0], [f32::NAN; 3]])
///     .analog_rate_hz(400.0)
///     .analog("EMG1", "V", vec![0.1, 0.2, 0.3, 0.4])
///     .event("Foot Off", "Left", 0.005)
///     .build()?;
/// let read = C3dFile::from_bytes(&file.to_bytes()?)?;
/// assert_eq!(read.points[0].xyz[0], [1.0, 2.0, 3.0]);
/// assert!(read.points[0].xyz[1][0].is_nan());
/// # Ok::<(), aloft_c3d::C3dError>(())
/// ```
#[derive(Debug, Clone)]
pub struct C3dBuilder {
    file: C3dFile,
    /// Plates whose channels are created when the file is built: plate index, wrench.
    wrenches: Vec<(usize, PlateWrench)>,
    analog_rate_hz: Option<f64>,
}

impl C3dBuilder {
    /// Starts a file with a point rate, Hz.
    pub fn new(point_rate_hz: f64) -> Self {
        let file = C3dFile {
            point_rate_hz,
            first_frame: 1,
            n_frames: 0,
            point_unit: "mm".to_owned(),
            points: Vec::new(),
            analogs: Vec::new(),
            analog_rate_hz: point_rate_hz,
            events: Vec::new(),
            plates: Vec::new(),
            poses: SegmentPoses::default(),
            warnings: Vec::new(),
            groups: Parameters::default(),
            header_events: Vec::new(),
            byte_order: ByteOrder::Intel,
            storage: Storage::Float,
            point_scale: 1.0,
            analog_general_scale: 1.0,
            analog_unsigned: false,
            source: None,
        };
        Self { file, wrenches: Vec::new(), analog_rate_hz: None }
    }
    /// Number of the first frame, 1-based; 1 by default.
    pub fn first_frame(mut self, number: u32) -> Self {
        self.file.first_frame = number.max(1);
        self
    }
    /// Unit of the markers; `mm` by default.
    pub fn point_unit(mut self, unit: &str) -> Self {
        self.file.point_unit = unit.to_owned();
        self
    }
    /// Analog rate, Hz: an integer multiple of the point rate. By default the rate at which the
    /// channels are as long as the points.
    pub fn analog_rate_hz(mut self, rate_hz: f64) -> Self {
        self.analog_rate_hz = Some(rate_hz);
        self
    }
    /// Byte order and storage. `point_scale` is the size of one integer step in point units, and of
    /// one step of residual.
    pub fn stored_as(mut self, byte_order: ByteOrder, storage: Storage, point_scale: f32) -> Self {
        self.file.byte_order = byte_order;
        self.file.storage = storage;
        self.file.point_scale = point_scale.abs();
        self
    }
    /// Raw integer samples and offsets of the channels are unsigned 16-bit numbers; this affects
    /// integer storage only.
    pub fn unsigned_analogs(mut self) -> Self {
        self.file.analog_unsigned = true;
        self.file.groups.set("ANALOG", Parameter::text("FORMAT", "UNSIGNED"));
        self.file.groups.set("ANALOG", Parameter::integer("BITS", 16));
        self
    }
    /// A marker; NaN where it was not seen.
    pub fn marker(self, label: &str, xyz: Vec<[f32; 3]>) -> Self {
        self.point(Point { label: label.to_owned(), xyz, ..Point::default() })
    }
    /// A marker with residuals in point units.
    pub fn marker_with_residual(self, label: &str, xyz: Vec<[f32; 3]>, residual: Vec<f32>) -> Self {
        self.point(Point { label: label.to_owned(), xyz, residual, ..Point::default() })
    }
    /// A computed point: joint angles, forces, moments, powers, scalars with their unit.
    pub fn computed(self, label: &str, kind: PointKind, unit: &str, xyz: Vec<[f32; 3]>) -> Self {
        self.point(Point { label: label.to_owned(), kind, unit: unit.to_owned(), xyz, ..Point::default() })
    }
    /// Any point. Residuals and camera masks that are empty become 0 (NaN and 0 where a coordinate
    /// is NaN).
    pub fn point(mut self, mut point: Point) -> Self {
        if point.residual.is_empty() {
            point.residual =
                point.xyz.iter().map(|p| if p.iter().any(|x| x.is_nan()) { f32::NAN } else { 0.0 }).collect();
        }
        if point.cameras.is_empty() {
            point.cameras = vec![0; point.xyz.len()];
        }
        if point.unit.is_empty() && point.kind == PointKind::Marker {
            point.unit = self.file.point_unit.clone();
        }
        self.file.points.push(point);
        self
    }
    /// A channel: label, unit, values in that unit.
    pub fn analog(self, label: &str, unit: &str, values: Vec<f64>) -> Self {
        self.channel(Analog { label: label.to_owned(), unit: unit.to_owned(), scale: 1.0, values, ..Analog::default() })
    }
    /// A channel with its own scale and offset, which are used in integer storage.
    pub fn channel(mut self, analog: Analog) -> Self {
        self.file.analogs.push(analog);
        self
    }
    /// A plate of type 2 that measured this reaction on the subject (world axes of the file, N and
    /// N·m about the world origin). Corners in point units and in the order (+x +y), (−x +y), (−x
    /// −y), (+x −y) of the plate's axes, whose z points down in most laboratories; origin from the
    /// sensor to the surface in plate axes (z usually negative). Six channels `Fx1` … `Mz1` are
    /// added, N and N·point unit.
    pub fn plate(mut self, corners: [[f64; 3]; 4], origin: [f64; 3], reaction: PlateWrench) -> Self {
        let plate = PlateDescription { kind: 2, corners, origin, ..PlateDescription::default() };
        self.wrenches.push((self.file.plates.len(), reaction));
        self.file.plates.push(plate);
        self
    }
    /// A plate whose channels are added separately.
    pub fn described_plate(mut self, plate: PlateDescription) -> Self {
        self.file.plates.push(plate);
        self
    }
    /// An event: label, context, and time in seconds on the clock on which frame 1 is at 0 s.
    pub fn event(self, label: &str, context: &str, time_s: f64) -> Self {
        self.full_event(FileEvent {
            label: label.to_owned(),
            context: context.to_owned(),
            time_s,
            ..FileEvent::default()
        })
    }
    /// An event that also has a subject and a description.
    pub fn full_event(mut self, event: FileEvent) -> Self {
        self.file.events.push(event);
        self
    }
    /// A header event, for old programs; the first 18 are kept, labels truncated to four
    /// characters.
    pub fn header_event(mut self, label: &str, time_s: f32) -> Self {
        let label = label.bytes().take(4).map(char::from).collect();
        self.file.header_events.push(HeaderEvent { label, time_s, shown: true });
        self.file.header_events.truncate(18);
        self
    }
    /// Poses of body segments (group ROTATION).
    pub fn poses(mut self, poses: SegmentPoses) -> Self {
        self.file.poses = poses;
        self
    }
    /// A parameter of any group.
    pub fn parameter(mut self, group: &str, parameter: Parameter) -> Self {
        self.file.groups.set(group, parameter);
        self
    }

    /// Builds the file and fills in its standard groups.
    ///
    /// # Errors
    /// [`C3dError::Write`] if lengths are inconsistent, the analog rate is not a multiple of the
    /// point rate, a plate's corners do not span a rectangle, or something does not fit into the
    /// format.
    pub fn build(self) -> Result<C3dFile, C3dError> {
        let Self { mut file, wrenches, analog_rate_hz } = self;
        let fail = |item: &str, problem: String| C3dError::Write { item: item.to_owned(), problem };
        if !(file.point_rate_hz.is_finite() && file.point_rate_hz > 0.0) {
            return Err(fail("point rate", format!("{} Hz", file.point_rate_hz)));
        }
        for (index, wrench) in wrenches {
            add_plate_channels(&mut file, index, &wrench)?;
        }
        let samples = file.analogs.first().map(|a| a.values.len());
        let points = file.points.first().map(|p| p.xyz.len());
        let per_frame = match (analog_rate_hz, points, samples) {
            (Some(rate), _, _) => {
                let ratio = rate / file.point_rate_hz;
                let whole = ratio.round();
                if !(whole >= 1.0 && (ratio - whole).abs() < 1e-6 * whole) {
                    let problem = format!("{rate} Hz is no multiple of the point rate {} Hz", file.point_rate_hz);
                    return Err(fail("analog rate", problem));
                }
                whole as usize
            }
            (None, Some(points), Some(samples)) if points > 0 => (samples / points).max(1),
            _ => 1,
        };
        file.n_frames = points.or_else(|| samples.map(|s| s / per_frame)).unwrap_or_else(|| file.poses.n_frames());
        file.analog_rate_hz = file.point_rate_hz * per_frame as f64;
        if let Some(odd) = file.analogs.iter().find(|a| a.values.len() != file.n_frames * per_frame) {
            let problem = format!("{} values, expected {} frames of {per_frame}", odd.values.len(), file.n_frames);
            return Err(fail(&format!("channel {}", odd.label), problem));
        }
        let layout = file.layout()?;
        file.groups = parameter_sync::synchronized(&file, &layout)?;
        // Standard groups first, as in most files.
        let standard = ["POINT", "ANALOG", "FORCE_PLATFORM", "EVENT_CONTEXT", "EVENT", "TRIAL"];
        let groups = &mut file.groups.groups;
        groups.sort_by_key(|g| standard.iter().position(|name| g.name.is(name)).unwrap_or(standard.len()));
        for (group, id) in groups.iter_mut().zip(1..=u8::MAX) {
            group.id = id;
        }
        Ok(file)
    }
}

/// Six channels in plate axes about the sensor, from a wrench in world axes about the world origin.
fn add_plate_channels(file: &mut C3dFile, index: usize, wrench: &PlateWrench) -> Result<(), C3dError> {
    let fail = |problem: String| C3dError::Write { item: format!("plate {}", index + 1), problem };
    let metres = unit::metres_per(&file.point_unit).ok_or_else(|| fail(format!("point unit `{}`", file.point_unit)))?;
    let plate = &file.plates[index];
    let frame = plate.frame().ok_or_else(|| fail(format!("corners {:?} span no plate", plate.corners)))?;
    if wrench.force_n.len() != wrench.moment_nm.len() {
        return Err(fail(format!("{} forces, {} moments", wrench.force_n.len(), wrench.moment_nm.len())));
    }
    let plate_from_world = frame.world_from_plate.transpose();
    let sensor_in_world = (frame.centre - frame.world_from_plate * Vector3::from(plate.origin)) * metres;
    let mut channels: [Vec<f64>; 6] = std::array::from_fn(|_| Vec::with_capacity(wrench.force_n.len()));
    for (force, moment) in wrench.force_n.iter().zip(&wrench.moment_nm) {
        let (force, moment) = (Vector3::from(*force), Vector3::from(*moment));
        let in_plate = plate_from_world * force;
        let about_sensor = plate_from_world * (moment - sensor_in_world.cross(&force)) / metres;
        for k in 0..3 {
            channels[k].push(in_plate[k]);
            channels[k + 3].push(about_sensor[k]);
        }
    }
    let first = file.analogs.len();
    let moment_unit = format!("N{}", file.point_unit);
    for (name, values) in ["Fx", "Fy", "Fz", "Mx", "My", "Mz"].into_iter().zip(channels) {
        let unit = if name.starts_with('F') { "N" } else { moment_unit.as_str() };
        file.analogs.push(Analog {
            label: format!("{name}{}", index + 1),
            unit: unit.to_owned(),
            scale: 1.0,
            values,
            ..Analog::default()
        });
    }
    file.plates[index].channels = (first..first + 6).collect();
    Ok(())
}
