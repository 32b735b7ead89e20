"""Inverse kinematics of one recording: OpenSim's tool on the same model, the same markers and weights, beside the stage `ik`.

    python tests/peers/bench_ik.py pipelines/drop_jump.yaml FOLDER DJ1     # FOLDER: the recordings; $ALOFT or the release binary

The subject that the study calibrated is built in OpenSim body by body (free, ball and pin joints, markers at their places) and starts from the
posture of the first frame, so both programs minimise the same distances; OpenSim reads the markers that the stage `import` left.
Ours counts the whole stage as its manifest states it, the least of ten: reading and writing tables included.
"""

import json
import os
import pathlib
import subprocess
import sys
import tempfile
import time

import numpy as np
import opensim as osim
import pyarrow.parquet as parquet

pipeline, recordings, trial = sys.argv[1:4]
target = pathlib.Path(os.environ.get("CARGO_TARGET_DIR", pathlib.Path(__file__).resolve().parents[2] / "target"))
aloft = os.environ.get("ALOFT", str(target / "release" / "aloft"))
workspace = pathlib.Path(tempfile.mkdtemp())
command = [aloft, "run", pipeline, "--data", recordings, "--workspace", str(workspace)]
subprocess.run(command, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
own = float("inf")
for _ in range(10):
    once = [*command, "--only", "ik", "--force", "--trial", trial]
    subprocess.run(once, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    own = min(own, json.loads((workspace / "ik" / trial / "manifest.json").read_text())["seconds"])
recording = parquet.read_table(workspace / "import" / trial / "markers.parquet").to_pydict()
motion = parquet.read_table(workspace / "ik" / trial / "motion.parquet").to_pydict()
first = {name: values[0] for name, values in motion.items()}
subject = json.loads(next(workspace.glob("calibrate/*/subject.json")).read_text())
report = json.loads((workspace / "ik" / trial / "report.json").read_text())


def euler(quaternion):
    """Body-fixed x y z angles of a quaternion x y z w."""
    x, y, z, w = quaternion
    r = osim.Rotation(osim.Quaternion(w, x, y, z))
    v = r.convertRotationToBodyFixedXYZ()
    return osim.Vec3(v[0], v[1], v[2])


model = osim.Model()
model.setName("subject")
bodies = []
zero = osim.Vec3(0)
for link in subject["model"]["links"]:
    body = osim.Body(link["name"], 1.0, zero, osim.Inertia(0.1, 0.1, 0.1))
    model.addBody(body)
    place = link["joint"]["parent_from_joint"]
    at, turn = osim.Vec3(*place["translation"]), euler(place["rotation"])
    kind = link["joint"]["kind"]
    name = f"{link['name']}_joint"
    if link["parent"] is None:
        joint = osim.FreeJoint(name, model.getGround(), zero, zero, body, zero, zero)
    else:
        parent = bodies[link["parent"]]
        if kind == "spherical":
            joint = osim.BallJoint(name, parent, at, turn, body, zero, zero)
        elif isinstance(kind, dict) and "revolute" in kind:
            axis = np.array(kind["revolute"], float)
            # PinJoint turns about z of its frames
            z = np.array([0.0, 0.0, 1.0])
            v, c = np.cross(z, axis), float(z @ axis)
            skew = np.array([[0, -v[2], v[1]], [v[2], 0, -v[0]], [-v[1], v[0], 0]])
            to_axis = np.eye(3) + skew + skew @ skew / (1 + c) if c > -1 + 1e-12 else np.diag([1.0, -1.0, -1.0])
            rotation = lambda m: osim.Rotation(osim.Mat33(*[float(x) for x in m.ravel()])).convertRotationToBodyFixedXYZ()
            x, y, zq, w = place["rotation"]
            base = np.array([[1 - 2 * (y * y + zq * zq), 2 * (x * y - w * zq), 2 * (x * zq + w * y)],
                             [2 * (x * y + w * zq), 1 - 2 * (x * x + zq * zq), 2 * (y * zq - w * x)],
                             [2 * (x * zq - w * y), 2 * (y * zq + w * x), 1 - 2 * (x * x + y * y)]])
            joint = osim.PinJoint(name, parent, at, rotation(base @ to_axis), body, zero, rotation(to_axis))
        else:
            joint = osim.WeldJoint(name, parent, at, turn, body, zero, zero)
    model.addJoint(joint)
    bodies.append(body)
    here = lambda *parts: [first[f"{link['name']}.{part}"] for part in parts]
    if link["parent"] is None:
        angles, shift = euler(here("qx", "qy", "qz", "qw")), here("x", "y", "z")
        start = [angles[0], angles[1], angles[2], *shift]
    elif kind == "spherical":
        angles = euler(here("qx", "qy", "qz", "qw"))
        start = [angles[0], angles[1], angles[2]]
    elif isinstance(kind, dict) and "revolute" in kind:
        start = here("angle")
    else:
        start = []
    for i, value in enumerate(start):
        joint.upd_coordinates(i).setDefaultValue(float(value))
for marker in subject["markers"]:
    model.addMarker(osim.Marker(marker["label"], bodies[marker["link"]], osim.Vec3(*marker["position_m"])))
model.finalizeConnections()

with tempfile.TemporaryDirectory() as folder:
    folder = pathlib.Path(folder)
    model.printToXML(str(folder / "subject.osim"))
    tasks = osim.IKTaskSet()
    for marker in subject["markers"]:
        task = osim.IKMarkerTask()
        task.setName(marker["label"])
        task.setWeight(float(marker["weight"]))
        tasks.cloneAndAppend(task)
    tool = osim.InverseKinematicsTool()
    tool.set_model_file(str(folder / "subject.osim"))
    times = recording["time_s"]
    labels = [m["label"] for m in subject["markers"] if f"{m['label']}.x" in recording]
    trc = folder / "markers.trc"
    with trc.open("w") as file:
        rate = (len(times) - 1) / (times[-1] - times[0])
        file.write("PathFileType\t4\t(X/Y/Z)\tmarkers.trc\n")
        file.write("DataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\tOrigDataRate\tOrigDataStartFrame\tOrigNumFrames\n")
        file.write(f"{rate}\t{rate}\t{len(times)}\t{len(labels)}\tm\t{rate}\t1\t{len(times)}\n")
        file.write("Frame#\tTime\t" + "\t\t\t".join(labels) + "\t\t\n")
        file.write("\t\t" + "\t".join(f"X{i}\tY{i}\tZ{i}" for i in range(1, len(labels) + 1)) + "\n\n")
        for f, t in enumerate(times):
            values = [recording[f"{label}.{axis}"][f] for label in labels for axis in "xyz"]
            file.write(f"{f + 1}\t{t}\t" + "\t".join("" if v != v else repr(v) for v in values) + "\n")
    tool.setMarkerDataFileName(str(trc))
    tool.set_IKTaskSet(tasks)
    tool.setOutputMotionFileName(str(folder / "out.mot"))
    tool.setResultsDir(str(folder))
    tool.set_report_errors(True)
    tool.setStartTime(times[0])
    tool.setEndTime(times[-1])
    osim.Logger.setLevelString("error")
    start = time.perf_counter()
    tool.run()
    seconds = time.perf_counter() - start
    errors = [line.split() for line in next(folder.glob("*ik_marker_errors.sto")).read_text().splitlines()]
    head = next(i for i, line in enumerate(errors) if line and line[0] == "endheader")
    column = errors[head + 1].index("marker_error_RMS")
    values = np.array([float(line[column]) for line in errors[head + 2 :]])
frames = len(times)
rms = float(np.sqrt(np.mean(values**2)))
print(f"{trial}: {frames} frames, {len(subject['markers'])} markers")
print(f"OpenSim {osim.GetVersion()}: {seconds:.2f} s, {frames / seconds:.0f} frames/s, marker RMS {1e3 * rms:.2f} mm")
print(f"aloft, stage ik with its tables: {own:.4f} s, {frames / own:.0f} frames/s, marker RMS {1e3 * report['rms_m']:.2f} mm")
print(f"OpenSim / aloft {seconds / own:.0f}")
