#!/usr/bin/env python3
"""What other programs make of an export of `aloft export`: they read it, compute with it, and are compared with what Aloft wrote.

    aloft run P.yaml --data D --workspace W && aloft export P.yaml --data D --workspace W --to OUT
    tests/peers/.venv/bin/python tests/peers/export_readers.py OUT [--recordings D] [--trial NAME]... [--limits]

OpenSim loads the model, runs its own inverse kinematics on our TRC and its own inverse dynamics on our MOT and loads; MuJoCo and Pinocchio
take the Parquet's orientations through their models; ezc3d reads the C3D beside the recording; pandas and polars read the tables.
Prints one Markdown table; with --limits exits 1 when a difference is larger than it should be.
"""
import argparse
import glob
import json
import os
import shutil
import sys
import tempfile

import numpy as np

ROWS, FAILED = [], []


def row(reader, trial, what, value, unit, limit=None):
    ROWS.append((reader, trial, what, f"{value:.3g}" if isinstance(value, float) else str(value), unit, "" if limit is None else f"{limit:g}"))
    if limit is not None and not value <= limit:
        FAILED.append(f"{reader} {trial}: {what} is {value} {unit}, limit {limit}")


def storage(path):
    """A MOT or STO table, independent of OpenSim: header flags and columns."""
    lines = open(path, encoding="utf-8").read().split("\n")
    end = next(i for i, l in enumerate(lines) if l.strip() == "endheader")
    header = dict(l.split("=", 1) for l in lines[:end] if "=" in l)
    labels = lines[end + 1].split("\t")
    data = np.array([[float(x) for x in l.split("\t")] for l in lines[end + 2:] if l.strip()])
    assert int(header["nRows"]) == len(data) and int(header["nColumns"]) == len(labels), path
    return header, dict(zip(labels, data.T.reshape(len(labels), -1)))


def on(times, t, x):
    return np.interp(times, t, x)


def complete(path, model):
    """Times of a TRC and whether every marker of the model is seen."""
    lines = open(path, encoding="utf-8").read().split("\n")
    labels = [x for x in lines[3].split("\t")[2:] if x]
    tracked = [m.getName() for m in model.getMarkerSet()]
    cells = [l.split("\t") for l in lines[6:] if l.strip()]
    columns = [2 + 3 * k for k, l in enumerate(labels) if l in tracked]
    return np.array([float(r[1]) for r in cells]), np.array([all(r[k] != "" for k in columns) for r in cells])


# ---------------------------------------------------------------- OpenSim
def opensim_reads(out, model_file, trials, work):
    import opensim as osim
    osim.Logger.setLevelString("Error")
    copy = os.path.join(work, "opensim")
    shutil.copytree(out, copy, ignore=shutil.ignore_patterns("Tables", "C3D", "BIDS"))
    name = os.path.basename(model_file)
    model = osim.Model(os.path.join(copy, "Models", name))
    state = model.initSystem()
    row("OpenSim " + osim.GetVersion().split("-")[0], "", "total mass", float(model.getTotalMass(state)), "kg")
    for trial in trials:
        t0 = os.path.join(copy, "IK", trial)
        if not os.path.exists(t0 + "_ik_setup.xml"):
            continue
        here = os.getcwd()
        os.chdir(os.path.join(copy, "IK"))  # paths in set-up files are relative to their folder
        ik = osim.InverseKinematicsTool(trial + "_ik_setup.xml")
        ik.run()
        _, ours = storage(t0 + "_ik.mot")
        _, theirs = storage(t0 + "_ik_opensim.mot")
        worst, rms, where, shift, gaps = 0.0, [], "", 0.0, 0.0
        # Where a marker is missing Aloft carries its pull across the gap and OpenSim leaves it out:
        # told apart here.
        seen = complete(os.path.join(copy, "MarkerData", trial + ".trc"), model)
        times, seen = seen[0], seen[1]
        whole = on(theirs["time"], times, seen.astype(float)) == 1.0
        rotational = [c for c in ours if c != "time" and not c[-3:] in ("_tx", "_ty", "_tz")]
        for c in ours:
            if c == "time":
                continue
            d = on(theirs["time"], ours["time"], ours[c]) - theirs[c]
            if c in rotational:
                d = (d + 180) % 360 - 180
                gaps = max(gaps, float(np.max(np.abs(d[~whole]), initial=0.0)))
                d = d[whole]
                rms.append(np.mean(d ** 2))
                if np.max(np.abs(d)) > worst:
                    worst, where = float(np.max(np.abs(d))), c
            else:
                shift = max(shift, float(np.max(np.abs(d))))
        row("OpenSim IK", trial, f"largest angle difference over {int(whole.sum())} frames in which every marker is seen ({where})", worst, "deg", 0.5)
        row("OpenSim IK", trial, "root mean square angle difference", float(np.sqrt(np.mean(rms))), "deg", 0.5)
        if (~whole).any():
            row("OpenSim IK", trial, f"largest in {int((~whole).sum())} frames with a marker missing", gaps, "deg")
        row("OpenSim IK", trial, "largest root displacement", 1e3 * shift, "mm")
        os.chdir(here)
        d0 = os.path.join(copy, "ID", trial)
        os.chdir(os.path.join(copy, "ID"))
        idt = osim.InverseDynamicsTool(trial + "_id_setup.xml")
        idt.run()
        os.chdir(here)
        _, ours = storage(d0 + "_id.sto")
        _, theirs = storage(d0 + "_id_opensim.sto")
        time = theirs["time"]
        inner = (time > time[0] + 0.1) & (time < time[-1] - 0.1)
        root = [c for c in list(ours)[1:7]]
        for what, columns, unit, limit in (
            ("root residual force", [c for c in root if c.endswith("_force")], "N", 1.0),
            ("root residual moment", [c for c in root if c.endswith("_moment")], "N.m", 0.2),
            ("joint moments", [c for c in list(ours)[7:] if c.endswith("_moment")], "N.m", 0.2),
        ):
            d = np.array([on(time, ours["time"], ours[c]) - theirs[c] for c in columns])[:, inner]
            size = np.array([theirs[c] for c in columns])[:, inner]
            row("OpenSim ID", trial, f"{what}: RMS difference (RMS of itself {np.sqrt(np.mean(size**2)):.3g})", float(np.sqrt(np.mean(d ** 2))), unit, limit)
            row("OpenSim ID", trial, f"{what}: median difference", float(np.median(np.abs(d))), unit)
            row("OpenSim ID", trial, f"{what}: largest difference", float(np.max(np.abs(d))), unit)


# ---------------------------------------------------------------- Parquet to postures
class Tidy:
    def __init__(self, path):
        import polars as pl
        self.frame = pl.read_parquet(path)
        self.series = {}
        for key, part in self.frame.partition_by(["quantity", "name", "axis"], as_dict=True, maintain_order=True).items():
            self.series[key] = part["value"].to_numpy()
        first = self.frame.partition_by(["quantity", "name", "axis"], maintain_order=True)[0]
        self.time = first["time_s"].to_numpy()
        self.in_flight = first["in_flight"].to_numpy()

    def get(self, quantity, name, axes=("x", "y", "z")):
        return np.stack([self.series[(quantity, name, a)] for a in axes], axis=-1)


GROUND = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])


def wrench_of_root(tau, root_rotation, body_axes):
    return np.hstack([tau[:3] if not body_axes else root_rotation @ tau[:3], root_rotation @ tau[3:6]])


def robotics_reads(out, subject, trials):
    """The same postures through MuJoCo and Pinocchio: centre of mass, momentum, base wrench. Reference: our STO and Parquet."""
    import mujoco
    import pinocchio as pin
    mj = mujoco.MjModel.from_xml_path(os.path.join(out, "Models", subject + ".xml"))
    data = mujoco.MjData(mj)
    row("MuJoCo " + mujoco.__version__, "", "total mass", float(mj.body_mass.sum()), "kg")
    row("MuJoCo " + mujoco.__version__, "", "degrees of freedom", mj.nv, "")
    pm = pin.buildModelFromUrdf(os.path.join(out, "Models", subject + ".urdf"), pin.JointModelFreeFlyer())
    pdata = pm.createData()
    row("Pinocchio " + pin.__version__, "", "total mass", float(pin.computeTotalMass(pm)), "kg")
    row("Pinocchio " + pin.__version__, "", "degrees of freedom", pm.nv, "")
    for trial in trials:
        path = os.path.join(out, "Tables", trial + ".parquet")
        sto = os.path.join(out, "IK", trial + "_velocities.sto")
        if not (os.path.exists(path) and os.path.exists(sto)):
            continue
        tidy = Tidy(path)
        _, q = storage(os.path.join(out, "IK", trial + "_ik_filtered.mot"))
        _, v = storage(sto)
        _, a = storage(os.path.join(out, "IK", trial + "_accelerations.sto"))
        _, residual = storage(os.path.join(out, "ID", trial + "_residual.sto"))
        _, generalised = storage(os.path.join(out, "ID", trial + "_id.sto"))
        names = [c for c in q if c != "time"]
        rootname = names[0].rsplit("_", 1)[0]
        offset = int(round(q["time"][0] / (tidy.time[1] - tidy.time[0])))
        plates = sorted({n for (k, n, _) in tidy.series if k == "ground_force"})
        regular = np.cos(np.radians(q[names[1]])) > np.sin(np.radians(5))
        stats = {k: [] for k in ("pin com", "mj com", "pin force", "pin moment", "mj force", "mj moment", "pin joint", "mj momentum", "mj angular")}
        for i in range(10, len(q["time"]) - 10, 7):
            f = i + offset
            row_q, row_v, row_a = ({c: s[c][i] for c in names} for s in (q, v, a))
            if not (all(np.isfinite(list(r.values())).all() for r in (row_q, row_v, row_a)) and regular[i]):
                continue
            # root pose: z-x-y turns of the ground
            def turn(axis, degrees):
                return pin.AngleAxis(np.radians(degrees), np.eye(3)[axis]).toRotationMatrix()
            rg = turn(2, row_q[names[0]]) @ turn(0, row_q[names[1]]) @ turn(1, row_q[names[2]])
            rw, pw = GROUND.T @ rg, GROUND.T @ np.array([row_q[c] for c in names[3:6]])
            # rates: angular velocity and acceleration in the moving frame
            r3, r2 = turn(1, row_q[names[2]]), turn(0, row_q[names[1]])
            c0, c1, c2 = r3.T @ r2.T @ np.eye(3)[2], r3.T @ np.eye(3)[0], np.eye(3)[1]
            d, dd = ([np.radians(s[c]) for c in names[:3]] for s in (row_v, row_a))
            w = c0 * d[0] + c1 * d[1] + c2 * d[2]
            dw = c0 * dd[0] + c1 * dd[1] + c2 * dd[2] - np.cross(c1 * d[1] + c2 * d[2], c0) * d[0] - np.cross(c2 * d[2], c1) * d[1]
            vw, aw = GROUND.T @ np.array([row_v[c] for c in names[3:6]]), GROUND.T @ np.array([row_a[c] for c in names[3:6]])
            quat = pin.Quaternion(rw)
            # Pinocchio: URDF coordinates are the MOT's, in radians
            pq, pv, pa = pin.neutral(pm), np.zeros(pm.nv), np.zeros(pm.nv)
            pq[:3], pq[3:7] = pw, [quat.x, quat.y, quat.z, quat.w]
            pv[:3], pv[3:6] = rw.T @ vw, w
            pa[:3], pa[3:6] = rw.T @ aw - np.cross(w, rw.T @ vw), dw
            for joint in list(pm.names)[2:]:
                jid = pm.getJointId(joint)
                j, length = pm.joints[jid], joint.endswith("_displacement")
                scale = 1.0 if length else np.pi / 180
                if j.nq == 2:  # continuous: cosine and sine
                    pq[j.idx_q:j.idx_q + 2] = [np.cos(row_q[joint] * scale), np.sin(row_q[joint] * scale)]
                else:
                    pq[j.idx_q] = row_q[joint] * scale
                pv[j.idx_v], pa[j.idx_v] = row_v[joint] * scale, row_a[joint] * scale
            tau = pin.rnea(pm, pdata, pq, pv, pa)
            force, moment = rw @ tau[:3], rw @ tau[3:6]
            pin.centerOfMass(pm, pdata, pq, pv)
            com = tidy.get("centre_of_mass", "whole_body")[f]
            stats["pin com"].append(np.linalg.norm(pdata.com[0] - com))
            # external wrench about the root's origin
            fe = sum((tidy.get("ground_force", p)[f] for p in plates), np.zeros(3))
            me = sum((tidy.get("ground_moment", p)[f] for p in plates), np.zeros(3)) - np.cross(pw, fe)
            ours_f = GROUND.T @ np.array([residual[f"{rootname}_residual_force_{x}"][i] for x in "xyz"])
            ours_m = GROUND.T @ np.array([residual[f"{rootname}_residual_moment_{x}"][i] for x in "xyz"])
            stats["pin force"].append(np.linalg.norm(force - fe - ours_f))
            stats["pin moment"].append(np.linalg.norm(moment - me - ours_m))
            if not plates:
                joint = [tau[pm.joints[pm.getJointId(n)].idx_v] - generalised[n + ("_force" if n.endswith("_displacement") else "_moment")][i] for n in list(pm.names)[2:]]
                stats["pin joint"].append(np.max(np.abs(joint)) if joint else 0.0)
            pin.computeCentroidalMomentum(pm, pdata)
            # MuJoCo: link poses by Pinocchio's frames give its quaternions
            pin.framesForwardKinematics(pm, pdata, pq)
            data.qpos[:3], data.qpos[3:7] = pw, [quat.w, quat.x, quat.y, quat.z]
            data.qvel[:3], data.qvel[3:6] = vw, w
            data.qacc[:3], data.qacc[3:6] = aw, dw
            pin.forwardKinematics(pm, pdata, pq, pv, pa)
            for jid in range(mj.njnt):
                kind, body = mj.jnt_type[jid], mj.jnt_bodyid[jid]
                if kind == mujoco.mjtJoint.mjJNT_FREE:
                    continue
                at, vat = mj.jnt_qposadr[jid], mj.jnt_dofadr[jid]
                link, parent = mj.body(body).name, mj.body(mj.body_parentid[body]).name
                fl, fp = pm.getFrameId(link), pm.getFrameId(parent)
                if kind == mujoco.mjtJoint.mjJNT_BALL:
                    base = pin.Quaternion(*mj.body_quat[body][[0, 1, 2, 3]])
                    r = base.toRotationMatrix().T @ pdata.oMf[fp].rotation.T @ pdata.oMf[fl].rotation
                    qq = pin.Quaternion(r)
                    data.qpos[at:at + 4] = [qq.w, qq.x, qq.y, qq.z]
                    jl = pm.frames[fl].parentJoint
                    jp = pm.frames[fp].parentJoint
                    rl, rp = pdata.oMi[jl].rotation, pdata.oMi[jp].rotation
                    wl, wp = pdata.v[jl].angular, pdata.v[jp].angular
                    rel = wl - rl.T @ rp @ wp
                    data.qvel[vat:vat + 3] = rel
                    al, ap = pdata.a[jl].angular, pdata.a[jp].angular
                    data.qacc[vat:vat + 3] = al - rl.T @ rp @ ap - np.cross(rl.T @ rp @ wp, rel)
                else:
                    # a hinge of the URDF may have its axis turned about; MuJoCo's has the link's
                    # own
                    n = [j for j in pm.names if pm.existJointName(j) and pm.joints[pm.getJointId(j)].nv == 1 and pm.getJointId(j) == pm.frames[fl].parentJoint][0]
                    axis_sign = sign_of(pm, n, mj.jnt_axis[jid], out, subject)
                    scale = 1.0 if n.endswith("_displacement") else np.pi / 180
                    data.qpos[at], data.qvel[vat], data.qacc[vat] = (axis_sign * s[n] * scale for s in (row_q, row_v, row_a))
            mujoco.mj_kinematics(mj, data)
            mujoco.mj_comPos(mj, data)
            mujoco.mj_comVel(mj, data)
            mujoco.mj_subtreeVel(mj, data)
            stats["mj com"].append(np.linalg.norm(data.subtree_com[1] - com))
            p = pdata.hg.linear
            stats["mj momentum"].append(np.linalg.norm(data.subtree_linvel[1] * mj.body_subtreemass[1] - p))
            stats["mj angular"].append(np.linalg.norm(data.subtree_angmom[1] - pdata.hg.angular))
            mujoco.mj_inverse(mj, data)
            stats["mj force"].append(np.linalg.norm(data.qfrc_inverse[:3] - fe - ours_f))
            stats["mj moment"].append(np.linalg.norm(rw @ data.qfrc_inverse[3:6] - me - ours_m))
        words = {
            "pin com": ("Pinocchio", "centre of mass against ours", "m", 1e-6),
            "pin force": ("Pinocchio", "base force less plates against our residual", "N", 1e-2),
            "pin moment": ("Pinocchio", "base moment less plates against our residual", "N.m", 1e-2),
            "pin joint": ("Pinocchio", "joint moments against ours", "N.m", 1e-2),
            "mj com": ("MuJoCo", "centre of mass against ours", "m", 1e-6),
            "mj momentum": ("MuJoCo", "linear momentum against Pinocchio's", "kg.m/s", 1e-6),
            "mj angular": ("MuJoCo", "angular momentum about the centre of mass against Pinocchio's", "kg.m2/s", 1e-6),
            "mj force": ("MuJoCo", "base force less plates against our residual", "N", 1e-2),
            "mj moment": ("MuJoCo", "base moment less plates against our residual", "N.m", 1e-2),
        }
        for key, values in stats.items():
            if values:
                reader, what, unit, limit = words[key]
                row(reader, trial, f"{what}, largest of {len(values)} frames", float(np.max(values)), unit, limit)


_AXES = {}


def sign_of(pm, joint, mj_axis, out, subject):
    """+1 where the URDF's axis of a joint is MuJoCo's, −1 where it is turned about."""
    import xml.etree.ElementTree as ET
    if not _AXES:
        for j in ET.parse(os.path.join(out, "Models", subject + ".urdf")).getroot().findall("joint"):
            if j.find("axis") is not None:
                _AXES[j.get("name")] = np.array([float(x) for x in j.find("axis").get("xyz").split()])
    return float(np.sign(_AXES[joint] @ np.asarray(mj_axis)))


# ---------------------------------------------------------------- C3D
def ezc3d_reads(out, trials, recordings):
    import ezc3d
    for trial in trials:
        path = os.path.join(out, "C3D", trial + ".c3d")
        if not os.path.exists(path):
            continue
        new = ezc3d.c3d(path)
        labels = new["parameters"]["POINT"]["LABELS"]["value"]
        labels += new["parameters"]["POINT"].get("LABELS2", {"value": []})["value"]
        points = new["data"]["points"]
        angles = new["parameters"]["POINT"].get("ANGLES", {"value": []})["value"]
        events = new["parameters"].get("EVENT", {}).get("LABELS", {"value": []})["value"]
        row("ezc3d", trial, "points, angles, flight events", f"{points.shape[1]}, {len(angles)}, {sum('Flight' in e for e in events)}", "")
        # joint angles against the MOT
        source = glob.glob(os.path.join(recordings, "**", trial + ".c3d"), recursive=True) if recordings else []
        mot = os.path.join(out, "IK", trial + "_ik.mot")
        groups = {"RHipAngles": ["hip_flexion_r", "hip_adduction_r", "hip_rotation_r"], "LKneeAngles": ["knee_angle_l"], "link0Angles": ["link0_rz", "link0_rx", "link0_ry"], "link1Angles": ["link1_angle"]}
        if os.path.exists(mot):
            _, q = storage(mot)
            for group, names in groups.items():
                at = [i for i, l in enumerate(labels) if l in (group, group + "_aloft")]
                if at and names[0] in q:
                    rate = new["parameters"]["POINT"]["RATE"]["value"][0]
                    first = int(round(q["time"][0] * rate))
                    d = [np.nanmax(np.abs(points[k, at[-1], first:first + len(q["time"])] - q[n])) for k, n in enumerate(names)]
                    row("ezc3d", trial, f"{group} against the MOT, largest difference", float(max(d)), "deg", 1e-3)
        if source:
            old = ezc3d.c3d(source[0])
            n = old["data"]["points"].shape[1]
            before, after = old["data"]["points"][:3], points[:3, :n]
            same = (before == after) | np.isnan(before)
            row("ezc3d", trial, f"old samples that changed, of {np.isfinite(before).sum()} seen", int((~same).sum()), "", 0)
            row("ezc3d", trial, "samples filled in gaps", int((np.isnan(before) & np.isfinite(after)).sum() // 3), "")
            a, b = old["data"]["analogs"], new["data"]["analogs"]
            row("ezc3d", trial, f"analog samples that changed, of {a.size}", int((~((a == b) | (np.isnan(a) & np.isnan(b)))).sum()), "", 0)
            lost = [f"{g}:{p}" for g in old["parameters"] if not g.startswith("__") for p in old["parameters"][g]
                    if not p.startswith("__") and p not in new["parameters"].get(g, {})]
            row("ezc3d", trial, "parameters lost", len(lost), " ".join(lost[:3]), 0)


# ---------------------------------------------------------------- tables
def tables_read(out, trials):
    import pandas as pd
    import polars as pl
    for trial in trials:
        parquet, csv = (os.path.join(out, "Tables", f"{trial}.{e}") for e in ("parquet", "csv"))
        if not (os.path.exists(parquet) and os.path.exists(csv)):
            continue
        a, b = pd.read_parquet(parquet), pl.read_parquet(parquet)
        assert list(a.columns) == b.columns and len(a) == len(b)
        same = np.array_equal(a["value"].to_numpy(), b["value"].to_numpy(), equal_nan=True)
        row("pandas, polars", trial, f"Parquet: {len(a)} rows, values that differ", 0 if same else 1, "", 0)
        wide, wide_pl = pd.read_csv(csv), pl.read_csv(csv, infer_schema_length=None)
        assert list(wide.columns) == wide_pl.columns and len(wide) == len(wide_pl)
        long = a.assign(heading=[" ".join(w for w in t if w) + f" [{u}]" for *t, u in zip(a["quantity"], a["name"], a["axis"], a["unit"])])
        pivot = long.pivot(index="frame", columns="heading", values="value")
        d = max(np.nanmax(np.abs(pivot[h].to_numpy() - wide[h].to_numpy()), initial=0.0) for h in pivot.columns)
        missing = sum(int((pivot[h].isna().to_numpy() != wide[h].isna().to_numpy()).sum()) for h in pivot.columns)
        row("pandas, polars", trial, f"CSV ({len(wide.columns)} columns) against Parquet, largest difference", float(d), "", 1e-6)
        row("pandas, polars", trial, "cells missing in one of them", missing, "", 0)


def bids_reads(out):
    import pandas as pd
    for tsv in sorted(glob.glob(os.path.join(out, "BIDS", "**", "*_motion.tsv"), recursive=True))[:3]:
        channels = pd.read_csv(tsv.replace("_motion.tsv", "_channels.tsv"), sep="\t", keep_default_na=False)
        motion = pd.read_csv(tsv, sep="\t", header=None, na_values="n/a")
        about = json.load(open(tsv.replace("_motion.tsv", "_motion.json")))
        assert len(channels) == motion.shape[1] == about["MotionChannelCount"], tsv
        row("pandas", os.path.basename(tsv), f"BIDS-Motion: channels, frames at {about['SamplingFrequency']} Hz", f"{motion.shape[1]}, {motion.shape[0]}", "")


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("out")
    parser.add_argument("--recordings")
    parser.add_argument("--trial", action="append")
    parser.add_argument("--limits", action="store_true")
    args = parser.parse_args()
    model = [m for m in glob.glob(os.path.join(args.out, "Models", "*.osim")) if not m.endswith("_prior.osim")][0]
    subject = os.path.basename(model)[:-5]
    found = sorted(os.path.basename(p)[:-4] for p in glob.glob(os.path.join(args.out, "MarkerData", "*.trc")))
    trials = [t for t in found if not args.trial or t in args.trial]
    out = os.path.abspath(args.out)
    recordings = os.path.abspath(args.recordings) if args.recordings else None
    with tempfile.TemporaryDirectory() as work:
        opensim_reads(out, model, trials, work)
    robotics_reads(out, subject, trials)
    ezc3d_reads(out, trials, recordings)
    tables_read(out, trials)
    bids_reads(out)
    print("| reader | trial | what | value | unit | limit |\n|---|---|---|---|---|---|")
    for r in ROWS:
        print("| " + " | ".join(r) + " |")
    for f in FAILED:
        print("FAILED:", f, file=sys.stderr)
    return 1 if args.limits and FAILED else 0


if __name__ == "__main__":
    sys.exit(main())
