"""Makes crates/regressor/tests/data from the simulated truth motions.

    python identify_goldens.py DATA OUT [--recordings N] [--jumps N]

DATA holds chain_a, chain_p, subject_a with their truth; OUT receives, per set, NAME.json (model, markers, true parameters,
frames of flights, rate) and NAME.i32 (little-endian coordinates in units of 5e-9 (m, quaternion, rad),
frame by frame). For the subject, NAME.f32 holds v and a of every fourth frame of the flights.
"""
import argparse, json, pathlib
import numpy as np
from scipy.spatial.transform import Rotation

PAD = 30
UNIT = 5e-9


def ours(phi):
    """m, mc, Ixx Ixy Iyy Ixz Iyz Izz -> m, mc, Ixx Iyy Izz Iyz Izx Ixy."""
    return [phi[i] for i in (0, 1, 2, 3, 4, 6, 9, 8, 7, 5)]


def chain(data, out, name, recordings):
    truth = json.loads((data / name / "truth/truth.json").read_text())
    rotation = Rotation.from_matrix(truth["hinge"]["R_link0_link1_q0"])
    rpy = rotation.as_euler("xyz")
    model = {"name": "two_link", "links": [
        {"name": "link0", "joint": "free"},
        {"name": "link1", "parent": "link0", "joint": "revolute_z", "position_m": truth["hinge"]["p_link0"], "rpy_rad": list(rpy)}]}
    blocks, flights, at = [], [], 0
    for r in range(1, recordings + 1):
        d = np.load(data / name / f"truth/throws_{r:02d}.npz")
        q = d["qpos"][:, [0, 1, 2, 4, 5, 6, 3, 7]].copy()
        for first, last in d["flight_intervals"]:
            block = q[first - PAD:last + 1 + PAD].copy()
            # quaternions change sign nowhere inside a block
            for i in range(1, len(block)):
                if block[i, 3:7] @ block[i - 1, 3:7] < 0:
                    block[i, 3:7] *= -1
            block[:, 7] -= 2 * np.pi * np.round(np.median(block[:, 7]) / (2 * np.pi))
            flights.append([at, at + PAD, at + PAD + int(last + 1 - first), at + len(block)])
            at += len(block)
            blocks.append(block)
    q = np.vstack(blocks)
    assert np.abs(q).max() < 10.7, np.abs(q).max(0)
    np.round(q / UNIT).astype("<i4").tofile(out / f"{name}.i32")
    markers = [[0, p] for p in truth["markers_link0_m"]] + [[1, p] for p in truth["markers_link1_m"]]
    (out / f"{name}.json").write_text(json.dumps({
        "model": model, "gravity_mps2": truth["true_gravity"], "rate_hz": truth["true_rate_hz"], "markers": markers,
        "phi": [ours(truth["link0"]["phi"]), ours(truth["link1"]["phi"])], "flights": flights}))


def subject(data, out, name, jumps):
    truth = json.loads((data / name / "truth/truth.json").read_text())
    links, index = [], {}
    for i, link in enumerate(truth["links"]):
        index[link["name"]] = i
        joint = {"free": "free", "spherical": "spherical", "revolute_x": {"revolute": [1, 0, 0]}, "revolute_y": {"revolute": [0, 1, 0]},
                 "revolute_z": {"revolute": [0, 0, 1]}}[link["joint"]]
        entry = {"name": link["name"], "joint": joint, "position_m": link["offset"]}
        if link["parent"] is not None:
            entry["parent"] = link["parent"]
        links.append(entry)
    q, v, a, flights, at = [], [], [], [], 0
    for j in range(1, jumps + 1):
        d = np.load(data / name / f"truth/truth_jump{j:02d}.npz")
        t = d["t_frame"]
        for begin, end in d["flights"]:
            inside = np.where((t > begin + 1e-6) & (t < end - 1e-6))[0]
            block = d["q"][inside].astype(float)
            flights.append([at, at, at + len(inside), at + len(inside)])
            at += len(inside)
            q.append(block), v.append(d["v"][inside]), a.append(d["a"][inside])
    q, v, a = np.vstack(q), np.vstack(v), np.vstack(a)
    assert np.abs(q).max() < 10.7, np.abs(q).max(0)
    rate = 1 / np.median(np.diff(t))
    np.round(q / UNIT).astype("<i4").tofile(out / f"{name}.i32")
    np.hstack([v, a])[::4].astype("<f4").tofile(out / f"{name}.f32")
    markers = truth["markers"]
    listed = []
    for key, m in (markers.items() if isinstance(markers, dict) else enumerate(markers)):
        listed.append([index[m["link"] if isinstance(m, dict) else m[0]], list(m["pos"] if isinstance(m, dict) else m[1])])
    (out / f"{name}.json").write_text(json.dumps({
        "model": {"name": name, "links": links}, "gravity_mps2": [0, 0, -9.81], "rate_hz": rate, "markers": listed,
        "phi": [ours(link["phi"]) for link in truth["links"]], "flights": flights}))


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("data", type=pathlib.Path)
    parser.add_argument("out", type=pathlib.Path)
    parser.add_argument("--recordings", type=int, default=2)
    parser.add_argument("--jumps", type=int, default=1)
    args = parser.parse_args()
    args.out.mkdir(parents=True, exist_ok=True)
    chain(args.data, args.out, "chain_p", args.recordings)
    chain(args.data, args.out, "chain_a", args.recordings)
    subject(args.data, args.out, "subject_a", args.jumps)
