#!/usr/bin/env bash
# SPDX-License-Identifier: BSD-3-Clause
# jsfive 0.4.2 and h5wasm 0.10.3 (npm), h5py 3.16.0 (PyPI): whole numbers of 64 bits in HDF5. Wants node and npm.
# Guess: a reader of HDF5 gives the seed that is in the file, or refuses it.
# Seen: jsfive reads 2**53 + 1 as 2**53 and 2**63 + 12345 as 2**63 + 12288, the next number of double precision, from
#     datasets and attributes; doubles and small numbers are right. h5wasm gives all of them exactly.
# For users of stochastic integrators: a seed read in a page in the browser is another one, and a run repeated with it another path.
. "$(dirname "$0")/venv.sh" h5py==3.16.0 numpy==2.4.6
npm install --silent --no-audit --no-fund --no-package-lock jsfive@0.4.2 h5wasm@0.10.3 > log 2>&1
python - <<'END'
import h5py
import numpy as np

with h5py.File("a.h5", "w") as file:
    file.attrs["seed"] = np.uint64(2**63 + 12345)
    file["seeds"] = np.array([2**53 + 1, 2**63 + 12345, 7], dtype="u8")
    file["x"] = np.array([0.1, 1e-300])
END
cat > read.mjs <<'END'
import * as fs from "fs";
import { File } from "jsfive";
import h5wasm from "h5wasm/node";
const bytes = fs.readFileSync("a.h5");
const one = new File(bytes.buffer.slice(bytes.byteOffset, bytes.byteOffset + bytes.length), "a.h5");
await h5wasm.ready;
const two = new h5wasm.File("a.h5", "r");
const seeds = one.get("seeds").value.map((value) => BigInt(value));
console.log("jsfive", String(one.attrs["seed"]), seeds.join(" "), one.get("x").value.join(" "));
console.log("h5wasm", String(two.attrs["seed"].value), two.get("seeds").value.join(" "), two.get("x").value.join(" "));
END
node read.mjs | tee found
grep -q "^jsfive .* 9007199254740992 9223372036854788096 7 0.1 1e-300$" found
grep -q "^h5wasm 9223372036854788153 9007199254740993 9223372036854788153 7 0.1 1e-300$" found
