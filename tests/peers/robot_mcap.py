"""MCAP files of crates/robot's tests, written by other programs: mcap and mcap-ros2-support (ROS 2), rosbags (messages of ROS 1).

    pip install mcap mcap-ros2-support rosbags
    python tests/peers/robot_mcap.py                   (writes crates/robot/tests/mcap)
    python tests/peers/robot_mcap.py FOLDER            (writes fixtures/robot as whole recordings in MCAP into FOLDER)

The messages hold the first 0.24 s of fixtures/robot/throw_01; the base's pose is a topic of the same file. With FOLDER, `aloft run
pipelines/robot.yaml` with `identify: ["*.mcap"]` must give what it gives from CSV.
"""

import csv
import gzip
import pathlib
import shutil
import sys

from mcap.writer import CompressionType, Writer
from mcap_ros2.writer import Writer as Ros2Writer
from rosbags.typesys import Stores, get_typestore

ROOT = pathlib.Path(__file__).resolve().parent.parent.parent
START = 1_700_000_003
RULE = "=" * 80
HEADER = f"\n{RULE}\nMSG: std_msgs/Header\nbuiltin_interfaces/Time stamp\nstring frame_id\n{RULE}\nMSG: builtin_interfaces/Time\nint32 sec\nuint32 nanosec\n"
VECTOR = f"\n{RULE}\nMSG: geometry_msgs/Vector3\nfloat64 x\nfloat64 y\nfloat64 z\n"
QUATERNION = f"\n{RULE}\nMSG: geometry_msgs/Quaternion\nfloat64 x\nfloat64 y\nfloat64 z\nfloat64 w\n"
POINT = f"\n{RULE}\nMSG: geometry_msgs/Point\nfloat64 x\nfloat64 y\nfloat64 z\n"
POSE = f"\n{RULE}\nMSG: geometry_msgs/Pose\ngeometry_msgs/Point position\ngeometry_msgs/Quaternion orientation\n"
TWIST = f"\n{RULE}\nMSG: geometry_msgs/Twist\ngeometry_msgs/Vector3 linear\ngeometry_msgs/Vector3 angular\n"
TYPES = {
    "sensor_msgs/msg/JointState": "std_msgs/Header header\nstring[] name\nfloat64[] position\nfloat64[] velocity\nfloat64[] effort\n" + HEADER,
    "sensor_msgs/msg/Imu": "std_msgs/Header header\ngeometry_msgs/Quaternion orientation\nfloat64[9] orientation_covariance\n"
    "geometry_msgs/Vector3 angular_velocity\nfloat64[9] angular_velocity_covariance\ngeometry_msgs/Vector3 linear_acceleration\n"
    "float64[9] linear_acceleration_covariance\n" + HEADER + QUATERNION + VECTOR,
    "geometry_msgs/msg/PoseStamped": "std_msgs/Header header\ngeometry_msgs/Pose pose\n" + HEADER + POSE + POINT + QUATERNION,
    "nav_msgs/msg/Odometry": "std_msgs/Header header\nstring child_frame_id\ngeometry_msgs/PoseWithCovariance pose\n"
    "geometry_msgs/TwistWithCovariance twist\n" + HEADER + f"\n{RULE}\nMSG: geometry_msgs/PoseWithCovariance\ngeometry_msgs/Pose pose\n"
    f"float64[36] covariance\n{RULE}\nMSG: geometry_msgs/TwistWithCovariance\ngeometry_msgs/Twist twist\nfloat64[36] covariance\n"
    + POSE + POINT + QUATERNION + TWIST + VECTOR,
}


def table(path):
    opened = gzip.open(path, "rt") if path.suffix == ".gz" else open(path)
    with opened as f:
        return [{k: float(v) for k, v in row.items()} for row in csv.DictReader(f)]


def stamp(t):
    ns = START * 10**9 + round(t * 1e9)
    return {"sec": ns // 10**9, "nanosec": ns % 10**9}


def messages(name, base_type, most):
    """Topic, type, time in ns and content, in the order of time."""
    log = table(ROOT / "fixtures" / "robot" / f"{name}_robot.csv.gz")
    joints = [k[2:-4] for k in log[0] if k.startswith("q_")]
    out = []

    def add(topic, kind, t, **content):
        time = stamp(t)
        out.append((topic, kind, time["sec"] * 10**9 + time["nanosec"], {"header": {"stamp": time, "frame_id": "trunk"}, **content}))

    for r in log:
        if r["time_s"] > most:
            break
        add(
            "/joint_states", "sensor_msgs/msg/JointState", r["time_s"], name=joints,
            **{to: [r[of.format(j)] for j in joints] for to, of in (("position", "q_{}_rad"), ("velocity", "dq_{}_rad_s"), ("effort", "tau_meas_{}_nm"))},
        )
        v = lambda k, u: {a: r[f"{k}_{a}_{u}"] for a in "xyz"}
        add(
            "/imu/data", "sensor_msgs/msg/Imu", r["time_s"], orientation={"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0}, orientation_covariance=[0.0] * 9,
            angular_velocity=v("gyro", "rad_s"), angular_velocity_covariance=[0.0] * 9, linear_acceleration=v("acc", "m_s2"),
            linear_acceleration_covariance=[0.0] * 9,
        )
    for r in table(ROOT / "fixtures" / "robot" / f"{name}_base.csv"):
        if r["time_s"] > most:
            break
        pose = {"position": {a: r[f"{a}_m"] for a in "xyz"}, "orientation": {a: r[f"q{a}"] for a in "xyzw"}}
        if base_type == "nav_msgs/msg/Odometry":
            zero = {a: 0.0 for a in "xyz"}
            add("/base", base_type, r["time_s"], child_frame_id="trunk", pose={"pose": pose, "covariance": [0.0] * 36},
                twist={"twist": {"linear": zero, "angular": zero}, "covariance": [0.0] * 36})
        else:
            add("/base", base_type, r["time_s"], pose=pose)
    return sorted(out, key=lambda m: m[2])


def ros2(path, name, base_type, compression, most):
    with open(path, "wb") as f:
        writer = Ros2Writer(f, chunk_size=16 * 1024, compression=compression)
        schemas = {k: writer.register_msgdef(k, text) for k, text in TYPES.items()}
        for i, (topic, kind, time, content) in enumerate(messages(name, base_type, most)):
            writer.write_message(topic=topic, schema=schemas[kind], message=content, log_time=time + 10**6, publish_time=time, sequence=i)
        writer.finish()


def ros1(path, name, most):
    store = get_typestore(Stores.ROS1_NOETIC)

    def build(kind, content):
        t = store.types
        header = content["header"]
        h = t["std_msgs/msg/Header"](seq=0, stamp=t["builtin_interfaces/msg/Time"](**header["stamp"]), frame_id=header["frame_id"])
        import numpy as np

        if kind.endswith("JointState"):
            arrays = {k: np.array(content[k]) for k in ("position", "velocity", "effort")}
            return t[kind](header=h, name=content["name"], **arrays)
        vector, quaternion = t["geometry_msgs/msg/Vector3"], t["geometry_msgs/msg/Quaternion"]
        if kind.endswith("Imu"):
            nine = np.zeros(9)
            return t[kind](header=h, orientation=quaternion(**content["orientation"]), orientation_covariance=nine,
                           angular_velocity=vector(**content["angular_velocity"]), angular_velocity_covariance=nine,
                           linear_acceleration=vector(**content["linear_acceleration"]), linear_acceleration_covariance=nine)
        pose = t["geometry_msgs/msg/Pose"](position=t["geometry_msgs/msg/Point"](**content["pose"]["position"]),
                                           orientation=quaternion(**content["pose"]["orientation"]))
        return t[kind](header=h, pose=pose)

    with open(path, "wb") as f:
        writer = Writer(f, chunk_size=16 * 1024, compression=CompressionType.LZ4)
        writer.start(profile="ros1", library="robot_mcap.py")
        channels = {}
        for topic, kind, time, content in messages(name, "geometry_msgs/msg/PoseStamped", most):
            if topic not in channels:
                schema = writer.register_schema(name=kind.replace("/msg/", "/"), encoding="ros1msg", data=b"")
                channels[topic] = writer.register_channel(topic=topic, message_encoding="ros1", schema_id=schema)
            data = bytes(store.serialize_ros1(build(kind, content), kind))
            writer.add_message(channel_id=channels[topic], log_time=time, data=data, publish_time=time)
        writer.finish()


def main():
    if len(sys.argv) > 1:
        out = pathlib.Path(sys.argv[1])
        out.mkdir(parents=True, exist_ok=True)
        shutil.copytree(ROOT / "fixtures" / "robot" / "model", out / "model", dirs_exist_ok=True)
        shutil.copy(ROOT / "fixtures" / "robot" / "robot.yaml", out)
        for name in ("throw_01", "throw_02"):
            ros2(out / f"{name}.mcap", name, "geometry_msgs/msg/PoseStamped", CompressionType.ZSTD, 1e9)
        return
    out = ROOT / "crates" / "robot" / "tests" / "mcap"
    out.mkdir(parents=True, exist_ok=True)
    ros2(out / "zstd.mcap", "throw_01", "geometry_msgs/msg/PoseStamped", CompressionType.ZSTD, 0.24)
    ros2(out / "odometry_lz4.mcap", "throw_01", "nav_msgs/msg/Odometry", CompressionType.LZ4, 0.24)
    ros2(out / "plain.mcap", "throw_01", "geometry_msgs/msg/PoseStamped", CompressionType.NONE, 0.12)
    ros1(out / "ros1.mcap", "throw_01", 0.24)


main()
