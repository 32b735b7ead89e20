"""Writes the small Parquet files that the tests of the reader use, with pyarrow.

Every compression with pages of version 1 and 2; columns plain and as dictionaries, two row groups,
missing values, and the types in which logs keep times and contacts. `brotli_1.parquet` is not read:
its message is tested.

    tests/peers/.venv/bin/python tests/peers/robot_parquet.py     # writes fixtures/robot_parquet
"""

from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

OUT = Path(__file__).resolve().parents[2] / "fixtures/robot_parquet"
ROWS = 60


def table():
    i = np.arange(ROWS)
    start = np.datetime64("2026-03-01T10:00:00", "ns")
    missing = [None if k % 7 == 3 else 0.25 * k for k in range(ROWS)]
    return pa.table(
        {
            "time_s": 0.004 * i,
            "q_hip_rad": np.sin(0.1 * i),
            "tau_hip_nm": pa.array(missing, pa.float64()),
            "gyro_x_rad_s": pa.array(np.round(i / 20).astype(np.float32)),
            "count": pa.array(i, pa.int16()),
            "contact_foot": pa.array(i % 20 < 5),
            "timestamp": pa.array(start + 4_000_000 * i),
            "elapsed": pa.array(4_000 * i, pa.duration("us")),
            "state": pa.array([["hold", "fly"][k % 2] for k in range(ROWS)]),
            "pair": pa.array([[1.0, 2.0]] * ROWS),
        }
    )


if __name__ == "__main__":
    OUT.mkdir(exist_ok=True)
    for codec in ["none", "snappy", "gzip", "zstd", "lz4", "brotli"]:
        for version in ["1.0", "2.0"]:
            if codec == "brotli" and version == "2.0":
                continue
            pq.write_table(
                table(),
                OUT / f"{codec}_{version[0]}.parquet",
                compression=codec,
                data_page_version=version,
                use_dictionary=["gyro_x_rad_s", "count", "state"],
                row_group_size=40,
                data_page_size=100,
                write_batch_size=10,
                write_statistics=False,
                store_schema=True,
            )
    print(sum(f.stat().st_size for f in OUT.iterdir()), "bytes in", len(list(OUT.iterdir())), "files")
