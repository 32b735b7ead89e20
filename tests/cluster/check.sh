#!/usr/bin/env bash
# 50 trials on a Slurm cluster of two nodes, one trial broken, one node stopped midway; then what is missing; then nothing; then the trial
# mended. All results must equal those of a local run bit for bit.   check.sh ALOFT FOLDER [VENV]
set -euo pipefail
here=$(cd "$(dirname "$0")" && pwd)
aloft=$(realpath "$1")
folder=$(realpath -m "$2")
venv=${3:-$here/.venv}
export PATH="$venv/bin:$PATH" NO_COLOR=1
say() { printf '\n== %s\n' "$*"; }
fail() { printf 'FAILED: %s\n' "$*" >&2; exit 1; }
# ends a process and all below it
end_tree() {
    local below
    for below in $(pgrep -P "$1"); do end_tree "$below"; done
    kill -9 "$1" 2>/dev/null || true
}
# a node dies: its daemon, and every process of the jobs on it
stop_node() {
    local jobs id step
    jobs=$(squeue -h -t R -w "$1" -o %i)
    kill -9 "$(cat "slurm/slurmd-$1.pid")"
    rm "slurm/slurmd-$1.pid"
    for id in $jobs; do
        for step in $(pgrep -f "slurmstepd: \\[$id\\."); do end_tree "$step"; done
    done
    scontrol update nodename="$1" state=down reason=stopped
    echo $jobs > stopped
}
# trials for which a stage has left its mark
marks() { (cd shared/.workflow/chain && ls "$1"/*.done 2>/dev/null || true) | sed 's|.*/||; s|\.done$||' | sort; }
cluster() {
    timeout -s INT 1800 snakemake -s Snakefile --config aloft="$aloft" --executor slurm --jobs 4 --cores 2 --keep-going \
        --slurm-no-account --slurm-status-command squeue --slurm-init-seconds-before-status-checks 2 --slurm-no-requeue \
        --group-components from_import=13 from_ik=7 --default-resources mem_mb=200 runtime=5 slurm_partition=main > "$1.log" 2>&1
}
# one call, its time, its jobs
call() {
    local began code=0
    began=$(date +%s)
    "$2" "$1" || code=$?
    printf '%s s; %s of the graph; Slurm jobs: %s\n' "$(( $(date +%s) - began ))" \
        "$(grep -o '^[0-9]* of [0-9]* steps' "$1.log" | tail -1 | grep . || echo 'nothing')" "$(states "$1")"
    return $code
}
# how Slurm says that the jobs of a call ended
states() {
    local ids
    ids=$(grep -o 'SLURM jobid [0-9]*' "$1.log" | sed 's/.* /JobId=/' || true)
    if [ -n "$ids" ]; then
        grep -wF "$ids" slurm/jobs.txt | grep -o 'JobState=[A-Z_]*' | sed 's/.*=//' | sort | uniq -c | sed 's/^ *//' | paste -sd, -
    else
        echo none
    fi
}

rm -rf "$folder"
mkdir -p "$folder"
trap '"$here/slurm.sh" stop "$folder/slurm"' EXIT
"$aloft" simulate "$here/scenario.yaml" --out "$folder/lab" > /dev/null
cp "$folder/lab/throws_17.c3d" "$folder/throws_17.good"
head -c 600 "$folder/throws_17.good" > "$folder/lab/throws_17.c3d"
cp "$here/../../pipelines/chain.yaml" "$folder/chain.yaml"
cd "$folder"

say "the local run"
began=$(date +%s)
"$aloft" run chain.yaml --data lab --workspace local > local.log 2>&1 && fail "the broken trial was not seen" || test $? -eq 1
echo "$(( $(date +%s) - began )) s"
grep '^52 trials' local.log
"$aloft" discover chain.yaml --data lab --workspace local > local_discovery.txt
head -1 local_discovery.txt

say "the cluster"
"$here/slurm.sh" start "$folder/slurm"
"$aloft" workflow chain.yaml --data lab --workspace shared --engine snakemake --out Snakefile

say "first call; node n2 stops when ten trials have been tracked"
(
    until [ "$(marks ik | wc -l)" -ge 10 ] && [ -n "$(squeue -h -t R -w n2 -o %i)" ]; do sleep 0.2; done
    stop_node n2
) 2> /dev/null &
watcher=$!
call first cluster && fail "the first call says that all is well"
wait $watcher
[ -f stopped ] || fail "no node was stopped"
echo "Slurm jobs on the node when it stopped: $(cat stopped)"
marks regressor > first_marks
echo "trials through the regressor: $(wc -l < first_marks) of 50"
[ "$(wc -l < first_marks)" -lt 50 ] || fail "the node was stopped too late"
[ "$(wc -l < first_marks)" -ge 20 ] || fail "the other node did not go on"
(cd shared && ls regressor) > first_results
touch second_begins
sleep 1

say "second call, on the node that is left"
call second cluster && fail "the broken trial was not reported"
grep '^failed:' second.log | sort -u
[ "$(marks regressor | wc -l)" -eq 50 ] || fail "trials are missing still"
(cd shared && find regressor -name manifest.json -newer ../second_begins) | cut -d/ -f2 | sort > second_made
again=$(comm -12 first_results second_made)
[ -z "$again" ] || fail "made again although it was there: $again"
echo "results of the regressor there before: $(wc -l < first_results); made now: $(wc -l < second_made); no usable recording: 1"
[ $(( $(wc -l < first_results) + $(wc -l < second_made) )) -eq 49 ] || fail "49 of 50 trials should have a result"

"$aloft" discover chain.yaml --data lab --workspace shared > cluster_discovery.txt
head -1 cluster_discovery.txt
python3 "$here/same.py" local shared || fail "the cluster's results are not those of the local run"

say "third call: nothing to do but to name the broken trial again"
touch third_begins
sleep 1
call third cluster && fail "the broken trial was not reported"
grep '^failed:' third.log | sort -u
[ -z "$(find shared -name manifest.json -newer third_begins)" ] || fail "something was made again"

say "the trial mended: it, and what follows from it; the same file on the cores of this machine"
cp throws_17.good lab/throws_17.c3d
touch mended
sleep 1
cores() { snakemake -s Snakefile --config aloft="$aloft" --cores 2 --keep-going > "$1.log" 2>&1; }
call fourth cores || fail "see fourth.log"
find shared -name manifest.json -newer mended | cut -d/ -f2 | sort | uniq -c
began=$(date +%s)
"$aloft" run chain.yaml --data lab --workspace local > /dev/null 2>&1
echo "the same with aloft run: $(( $(date +%s) - began )) s"
"$aloft" discover chain.yaml --data lab --workspace local > /dev/null
"$aloft" discover chain.yaml --data lab --workspace shared > /dev/null
python3 "$here/same.py" local shared || fail "the cluster's results are not those of the local run"
say "all as it should be"
