#!/usr/bin/env python3
"""False alarms and power against the number of flights: `aloft discover` on the same laboratory recorded for longer and longer.

For each laboratory one effect of the catalogue is drawn, and the size at which it doubles the held-out error of the session of
REFERENCE flights is found. The same effect at SHARES of this size is then hidden in sessions of each number of flights, which
differ in nothing else but the draw of motion and noise. Empty sessions have nothing hidden.
Everything goes through the whole program from C3D; the search beyond the catalogue is left out (`--closed`). Usage:

  python3 benches/power.py --body chain --flights 6,12,25,50,100,200 --sets 10 --empty 20 --seed 1 --jobs 2 --out OUT
  python3 benches/power.py --score OUT [OUT ...]

Outcomes are those of `verdicts.py`; `none` is *nothing missing*, *not detectable* or *unexplained*. Results are lines of JSON
in OUT (`sizes.jsonl`, `sets.jsonl`); a run that was interrupted continues.
"""

import json
import random
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from laboratory import Laboratories, arguments, interval, parsed, read_lines, session
from verdicts import chain_effect, human_effect, judge

REFERENCE = 50
SHARES = [0.125, 0.25, 0.5]
# jumps of a person that give about one flight each: a jump trial has two or three
FLIGHTS_PER_JUMP = 2.5
# effects that need another protocol: they act in a part of the recordings or on the plates
LEFT_OUT = {"payload", "load", "plate_time_offset", "plate_gain", "body_mass"}


def laboratory(kind, rng):
    """Body, instruments, and an effect at a size with its right names."""
    where, capture = session(kind, rng)
    where["object" if kind == "chain" else "person"] = {**where.get("person", {}), "variation": round(rng.uniform(0.5, 1.5), 2)}
    while True:
        name, at, names = (chain_effect if kind == "chain" else human_effect)(rng)
        if name not in LEFT_OUT:
            return where, capture, name, at, names


def recorded(where, flights):
    """The same body in a session of this many flights."""
    if where["kind"] == "chain":
        recordings = 2 if flights < 12 else 3 if flights < 25 else 5
        return {**where, "throws": {"recordings": recordings, "throws": round(flights / recordings)}}
    return {**where, "protocol": {**where["protocol"], "jumps": max(2, round(flights / FLIGHTS_PER_JUMP))}}


class Bench(Laboratories):
    """One effect at fixed sizes, in sessions of several lengths."""

    def drawn(self, index):
        return laboratory(self.kind, random.Random(f"power {self.kind} {self.seed} {index}"))

    def scaled(self, index, known):
        """Size at which the effect doubles the error of the reference session; None if it cannot."""
        if index in known:
            return known[index]["size"]
        where, capture, name, at, _ = self.drawn(index)
        where, seed = recorded(where, REFERENCE), self.seed_of(index, REFERENCE)
        try:
            twin = self.error_of([(where, [], capture)], seed)[0]
            found = self.scale_for(lambda s: [(where, [at(s)], capture)], seed, twin, 2, 1.0)
        except (RuntimeError, ValueError, KeyError) as problem:
            print(f"laboratory {index}: {str(problem)[-200:]}", file=sys.stderr, flush=True)
            found = None
        # to the size that doubles the error: the hidden part of the error is proportional to it
        size = found and found[0] * (3 / (found[1] ** 2 - 1)) ** 0.5
        self.keep("sizes.jsonl", {"index": index, "kind": name, "size": size})
        return size

    def seed_of(self, index, flights):
        return 6_000_000 + 100_000 * self.seed + 1000 * index + flights

    def one(self, index, flights, known, done):
        size = self.scaled(index, known)
        if size is None:
            return
        where, capture, name, at, names = self.drawn(index)
        for n in flights:
            for share in SHARES:
                of = {"kind": name, "case": "one", "truth": [sorted(names)], "judged_on": "flight"}
                self.answer(f"{self.kind}-{index}-{n}-{share}", of, recorded(where, n), [at(share * size)], capture, index, n, share, done)

    def empty(self, index, flights, done):
        where, capture, *_ = self.drawn(1000 + index)
        for n in flights:
            of = {"kind": "empty", "case": "empty", "truth": []}
            self.answer(f"{self.kind}-empty{index}-{n}", of, recorded(where, n), [], capture, 1000 + index, n, 0, done)

    def answer(self, name, of, where, hidden, capture, index, flights, share, done):
        if name in done:
            return
        line = {"set": name, "body": self.kind, "program": self.digest, "flights": flights, "strength": share, **of}
        try:
            line |= self.ask(name, [(where, hidden, capture)], self.seed_of(index, flights), options=["--closed"])
        except (RuntimeError, ValueError, KeyError) as problem:
            line["problem"] = str(problem)[-300:]
        self.keep("sets.jsonl", line)
        said = (line.get("answer") or {}).get("words") or line.get("problem")
        print(f"{name:24s} {line['kind']:16s} {outcome(line):11s} {said[:140]}", flush=True)


def outcome(line):
    said = judge(line)
    return "none" if line["strength"] and said in ("missed", "unexplained") else said


def score(folders):
    lines = {line["set"]: line for folder in folders for line in read_lines(Path(folder) / "sets.jsonl")}
    for body in sorted({line["body"] for line in lines.values()}):
        of_body = [line for line in lines.values() if line["body"] == body and "answer" in line]
        names = ["right", "class", "wide class", "none", "wrong"]
        print(f"\n## {body}\n\n| flights | size | sets | " + " | ".join(names) + " |\n" + "|---" * (len(names) + 3) + "|")
        for flights in sorted({line["flights"] for line in of_body}):
            for share in [0, *SHARES]:
                group = [outcome(line) for line in of_body if (line["flights"], line["strength"]) == (flights, share)]
                if group:
                    # with nothing hidden, naming nothing is right
                    cells = [interval(group.count(name), len(group)) for name in names]
                    print(f"| {flights} | {f'{share:.1%}' if share else 'nothing'} | {len(group)} | " + " | ".join(cells) + " |")
        print(f"\nnot usable: {sum('answer' not in line for line in lines.values() if line['body'] == body)}")


def main():
    parser = arguments(__doc__)
    parser.add_argument("--flights", default="6,12,25,50,100,200")
    parser.add_argument("--sets", type=int, default=10)
    parser.add_argument("--empty", type=int, default=20)
    args = parsed(parser, score)
    bench = Bench(args)
    flights = [int(n) for n in args.flights.split(",")]
    known = {line["index"]: line for line in bench.lines("sizes.jsonl")}
    done = {line["set"] for line in bench.lines("sets.jsonl") if "answer" in line}
    with ThreadPoolExecutor(args.jobs) as pool:
        work = [pool.submit(bench.empty, i, flights, done) for i in range(args.empty)]
        work += [pool.submit(bench.one, i, flights, known, done) for i in range(args.sets)]
        for piece in work:
            piece.result()
    return score([args.out])


if __name__ == "__main__":
    sys.exit(main())
