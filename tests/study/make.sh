#!/bin/sh
# A study of four simulated subjects with 25 recordings each, six of them broken:
#   tests/study/make.sh OUT [ALOFT]
#   aloft run pipelines/study.yaml --data OUT --workspace WORKSPACE
# OUT must not exist. ALOFT is the command to use (`aloft` where not given).
set -eu
out=$1
aloft=${2:-aloft}
here=$(cd "$(dirname "$0")/../.." && pwd)
mkdir "$out"
printf 'participant_id\tsex\theight\tmass\n' > "$out/participants.tsv"
for s in sub-01 sub-02 sub-03 sub-04; do
    "$aloft" simulate "$here/fixtures/scenarios/study/$s.yaml" --out "$out/$s" > "$out/$s.log"
    rm "$out/$s.log"
    # the laboratory knows no more than the table of participants
    rm -rf "$out/$s/subject.yaml" "$out/$s/truth" "$out/$s/truth.json"
    person=$(grep person "$here/fixtures/scenarios/study/$s.yaml")
    value() { printf '%s' "$person" | sed "s/.*$1: \([^,}]*\).*/\1/"; }
    printf '%s\t%s\t%s\t%s\n' "$s" "$(value sex)" "$(value height_m)" "$(value mass_kg)" >> "$out/participants.tsv"
done
# six broken files
cut() { head -c "$2" "$1" > "$1.cut" && mv "$1.cut" "$1"; }
cut "$out/sub-01/jump07.c3d" 3000                                                      # a copy that stopped early
: > "$out/sub-01/jump15.c3d"                                                           # an empty file
printf 'Dear all, the recording is on the other disk.\n' > "$out/sub-02/jump03.c3d"    # not a recording
"$aloft" simulate "$here/fixtures/scenarios/chain_small.yaml" --out "$out/other" > /dev/null
mv "$out/other/throws_01.c3d" "$out/sub-02/jump11.c3d"                                 # somebody else's markers
rm -r "$out/other"
dd if=/dev/zero of="$out/sub-03/jump18.c3d" bs=512 count=2 conv=notrunc 2> /dev/null   # a damaged header
cut "$out/sub-04/exercise02.c3d" 40000                                                 # half of the frames are gone
