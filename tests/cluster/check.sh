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
fail() { printf 'FAILED: %s\n' "$*" >&2; exit 1; }
count() { grep -c "^    shell:\|^rule\|^localrule" "$1" || true; }

rm -rf "$folder"
mkdir -p "$folder"
trap '"$here/slurm.sh" stop "$folder/slurm"' EXIT
"$aloft" simulate "$here/scenario.yaml" --out "$folder/lab" > /dev/null
cp "$folder/lab/throws_17.c3d" "$folder/throws_17.good"
head -c 3000 "$folder/throws_17.good" > "$folder/lab/throws_17.c3d"
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
    snakemake -s Snakefile --config aloft="$aloft" --executor slurm --jobs 4 --keep-going --slurm-no-account \
        --slurm-status-command squeue --slurm-init-seconds-before-status-checks=2 \
        --group-components from_import=13 from_ik=5 \
        --default-resources mem_mb=200 runtime=5 slurm_partition=main > "$1" 2>&1
}
say "first call; node n2 stops when ten trials have been tracked"
(
    until [ "$(ls shared/.workflow/cluster/ik/*.done 2>/dev/null | wc -l)" -ge 10 ] || [ "$(ls shared/.workflow/*/ik/*.done 2>/dev/null | wc -l)" -ge 10 ]; do sleep 0.2; done
    scontrol update nodename=n2 state=down reason=stopped
    kill "$(cat slurm/slurmd-n2.pid)"
    date +%s.%N > stopped
) &
watcher=$!
start=$(date +%s)
run first.log && fail "the first call says that all is well" || true
wait $watcher
[ -f stopped ] || fail "no node was stopped"
done_first=$(ls shared/.workflow/*/regressor/*.done | wc -l)
echo "$(( $(date +%s) - start )) s; trials through the regressor: $done_first of 50; identified: $(ls shared/.workflow/*/identify/*.done 2>/dev/null | wc -l)"

say "what a second call would do"
snakemake -s Snakefile --config aloft="$aloft" --cores 1 --dry-run --quiet rules > missing.txt 2>&1 || true
snakemake -s Snakefile --config aloft="$aloft" --cores 1 --summary 2>/dev/null > before.txt || true
find shared -name manifest.json -newer stopped | sort > made_before.txt
touch second_begins
sleep 1

say "second call, on the node that is left"
start=$(date +%s)
run second.log && fail "the broken trial was not reported" || true
echo "$(( $(date +%s) - start )) s"
grep -A3 "throws_17" second.log | head -4 || true
made=$(find shared -name manifest.json -newer second_begins -path '*/regressor/*' | wc -l)
echo "regressor results made now: $made; missing before: $(( 50 - done_first ))"
[ "$made" -eq $(( 50 - done_first )) ] || fail "the second call did something else than what was missing"

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
