"""Guards speed: whole commands of this build against a frozen binary, in alternation, as ratios of processor seconds.

    python3 benches/guard.py FROZEN FOLDER [--quick] [--rounds N] [--trials N]

FROZEN is an earlier `aloft` binary (CONTRIBUTING.md says how to keep one); this build is $ALOFT or target/release/aloft. FOLDER keeps the
simulated recordings. Both binaries get the same recordings, each a workspace of its own; in every round each runs each command once, and
the order changes from round to round. Printed are the median and the range of the rounds' ratios, new over frozen: above 1 this build is
slower. Processor seconds of a busy machine scatter by 10 to 20 %, the ratio of neighbours in time by less.
"""

import argparse
import pathlib
import shutil
import statistics

from measure import ROOT, aloft, chain, laboratory, run

parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
parser.add_argument("frozen", type=pathlib.Path)
parser.add_argument("folder", type=pathlib.Path)
parser.add_argument("--quick", action="store_true", help="twenty trials and two rounds instead of 100 and five")
parser.add_argument("--rounds", type=int)
parser.add_argument("--trials", type=int)
options = parser.parse_args()
rounds = options.rounds or (2 if options.quick else 5)
trials = options.trials or (20 if options.quick else 100)
binaries = {"frozen": str(options.frozen.resolve()), "new": aloft()}

exercises = max(1, trials // 10)
study = laboratory(options.folder / f"study_{trials}", jumps=trials - exercises, exercises=exercises)
person = laboratory(options.folder / "person", jumps=6, exercises=1)
throws = chain(options.folder / "chain", recordings=10)
LABS = {"study": ("human", study), "person": ("human", person), "chain": ("chain", throws)}
# name, laboratory, command, whether it begins in an empty workspace
COMMANDS = [
    (f"study of {trials} trials", "study", ["run"], True),
    ("unchanged run", "study", ["run"], False),
    ("status", "study", ["status"], False),
    ("discover, chain", "chain", ["discover", "--again"], False),
    ("discover, person", "person", ["discover", "--again"], False),
]


def words(which, lab, command):
    """The command line; the workspace belongs to the binary."""
    pipeline, data = LABS[lab]
    where = ["--data", str(data), "--workspace", str(options.folder / f"workspace_{lab}_{which}")]
    return [binaries[which], command[0], str(ROOT / "pipelines" / f"{pipeline}.yaml"), *where, *command[1:]]


for which in binaries:
    for lab in ("chain", "person"):
        run(words(which, lab, ["run"]))
seconds = {name: {which: [] for which in binaries} for name, *_ in COMMANDS}
for turn in range(rounds):
    for name, lab, command, fresh in COMMANDS:
        for which in sorted(binaries, reverse=turn % 2 == 1):
            if fresh:
                shutil.rmtree(options.folder / f"workspace_{lab}_{which}", ignore_errors=True)
            seconds[name][which].append(run(words(which, lab, command), check=False)[1])

print(f"{'processor seconds':24} {'frozen':>8} {'new':>8}   new/frozen, median (range) of {rounds} rounds")
for name, found in seconds.items():
    ratios = [new / old for new, old in zip(found["new"], found["frozen"])]
    old, new = (statistics.median(found[which]) for which in ("frozen", "new"))
    print(f"{name:24} {old:8.2f} {new:8.2f}   {statistics.median(ratios):.2f} ({min(ratios):.2f} to {max(ratios):.2f})")
