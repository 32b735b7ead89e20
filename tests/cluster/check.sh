#!/usr/bin/env bash
# 50 trials on a Slurm cluster of two nodes, one trial broken, one node stopped midway; then what is missing; then the trial mended.
# Parameters and verdicts must equal those of a local run bit for bit.   check.sh ALOFT FOLDER [VENV]
set -euo pipefail
here=$(cd "$(dirname "$0")" && pwd)
aloft=$(realpath "$1")
folder=$(realpath -m "$2")
venv=${3:-$here/.venv}
export PATH="$venv/bin:$PATH" NO_COLOR=1
say() { printf '\n== %s\n' "$*"; }
# ends a process and all below it
end_tree() {
    local below
    for below in $(pgrep -P "$1"); do end_tree "$below"; done
    kill -9 "$1" 2>/dev/null || true
}
# a node dies: its daemon, and every process of the jobs on it
stop_node() {
    local jobs id
    jobs=$(squeue -h -t R -w "$1" -o %i)
    kill -9 "$(cat "slurm/slurmd-$1.pid")"
    rm "slurm/slurmd-$1.pid"
    for id in $jobs; do
        for step in $(pgrep -f "slurmstepd: \\[$id\\."); do end_tree "$step"; done
    done
    scontrol update nodename="$1" state=down reason=stopped
    echo "jobs on it: $jobs" > stopped
}
fail() { printf 'FAILED: %s\n' "$*" >&2; exit 1; }

rm -rf "$folder"
mkdir -p "$folder"
trap '"$here/slurm.sh" stop "$folder/slurm"' EXIT
"$aloft" simulate "$here/scenario.yaml" --out "$folder/lab" > /dev/null
cp "$folder/lab/throws_17.c3d" "$folder/throws_17.good"
head -c 600 "$folder/throws_17.good" > "$folder/lab/throws_17.c3d"
cp "$here/../../pipelines/chain.yaml" "$folder/chain.yaml"
cd "$folder"

say "the local run"
"$aloft" run chain.yaml --data lab --workspace local > local.log 2>&1 && fail "the broken trial was not seen" || test $? -eq 1
tail -3 local.log
"$aloft" discover chain.yaml --data lab --workspace local > local_discovery.txt
head -1 local_discovery.txt

say "the cluster"
"$here/slurm.sh" start "$folder/slurm"
"$aloft" workflow chain.yaml --data lab --workspace shared --engine snakemake --out Snakefile
run() {
    timeout -s INT 1200 snakemake -s Snakefile --config aloft="$aloft" --executor slurm --jobs 4 --keep-going --slurm-no-account \
        --slurm-status-command squeue --slurm-init-seconds-before-status-checks=2 \
        --group-components from_import=13 from_ik=7 \
        --default-resources mem_mb=200 runtime=5 slurm_partition=main > "$1" 2>&1
}
say "first call; node n2 stops when ten trials have been tracked"
(
    until [ "$(ls shared/.workflow/*/ik/*.done 2>/dev/null | wc -l)" -ge 10 ]; do sleep 0.2; done
    stop_node n2
) &
watcher=$!
start=$(date +%s)
run first.log && fail "the first call says that all is well" || true
wait $watcher
[ -f stopped ] || fail "no node was stopped"
cat stopped
marks() { (cd shared/.workflow/chain && ls regressor/*.done 2>/dev/null || true); }
marks > marks_first
echo "$(( $(date +%s) - start )) s; trials through the regressor: $(wc -l < marks_first) of 50; identified: $(ls shared/.workflow/*/identify/*.done 2>/dev/null | wc -l)"
[ "$(wc -l < marks_first)" -lt 50 ] || fail "the node was stopped too late"
[ "$(wc -l < marks_first)" -ge 20 ] || fail "the other node did not go on"
touch second_begins
sleep 1

say "second call, on the node that is left"
start=$(date +%s)
run second.log && fail "the broken trial was not reported" || true
echo "$(( $(date +%s) - start )) s"
grep "throws_17" second.log | grep "^failed" | head -1
marks > marks_second
[ "$(wc -l < marks_second)" -eq 50 ] || fail "trials are missing still"
find shared/regressor -name manifest.json -newer second_begins | sed 's|shared/regressor/||; s|/manifest.json||' | sort > made_second
again=$(sed 's|regressor/||; s|.done||' marks_first | sort | comm -12 - made_second)
[ -z "$again" ] || fail "made again although it was there: $again"
echo "results of the regressor made now: $(wc -l < made_second); marks missing before: $(( 50 - $(wc -l < marks_first) ))"

"$aloft" discover chain.yaml --data lab --workspace shared > cluster_discovery.txt
head -1 cluster_discovery.txt
python3 "$here/same.py" local shared || fail "the cluster's numbers are not those of the local run"

say "a third call has only the verdict to give again"
run third.log && fail "the broken trial was not reported" || true
[ -z "$(find shared -name manifest.json -newer cluster_discovery.txt)" ] || fail "something was made again"

say "the trial mended: it, and what follows from it; on the cores of this machine"
cp throws_17.good lab/throws_17.c3d
touch mended
sleep 1
snakemake -s Snakefile --config aloft="$aloft" --cores 2 --keep-going > fourth.log 2>&1 || fail "see fourth.log"
find shared -name manifest.json -newer mended | sed 's|shared/||; s|/manifest.json||' | sort
"$aloft" run chain.yaml --data lab --workspace local > /dev/null 2>&1
"$aloft" discover chain.yaml --data lab --workspace local > /dev/null
"$aloft" discover chain.yaml --data lab --workspace shared > /dev/null
python3 "$here/same.py" local shared || fail "the cluster's numbers are not those of the local run"
say "all as it should be"
