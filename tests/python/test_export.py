# SPDX-License-Identifier: BSD-3-Clause
"""Scenes as programs: compiled by the printed line, they print the moments of the scene."""

import re
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
from conftest import moments_of
from symsde.batch import scene
from symsde.cli import command_line

pytest.importorskip("sympy")

from symsde.export import given, in_fortran
from symsde.export.expressions import Expressions
from symsde.model.formulas.graph import Graph

if shutil.which("cc") is None:
    pytest.skip("no C compiler", allow_module_level=True)

ROOT = Path(__file__).parents[2]
HEADERS = ROOT / "include"
RUN = "[run]\nstep = 0.05\nsteps = 40\nsave_every = 20\npaths = 30\nseed = 18446744073709551615\nq0 = 0.4\np0 = 0.3\n"
SCENES = {
    # every function and operation, names that other languages reserve or do not distinguish, time
    "names": '[model]\nH = "double**2/2*A0 - cos(E*q)*a0 + exp(-I*q**2)/(1+q**2)**(3/2) + sqrt(1 + t**2)*q"\n'
    'noise = ["value*sin(q)*double", "-NULL*log(2+q**2)*tanh(q)"]\nq = "q"\np = "double"\n'
    "[model.params]\nA0 = 1.2\na0 = 0.7\nE = 1.1\nI = 0.5\nvalue = 0.2\nNULL = 0.3\n" + RUN + 'scheme = "gauss2"\n',
    # functions that languages lack, and functions that appear in derivatives
    "walls": '[model]\nH = "p**2/2 + sech(q) + a*coth(q+2) + csch(q+3) + erfc(q) + log(cosh(q)) + log(1+exp(q))"\n'
    'noise = ["0.1*log(1+exp(-q))*tanh(q)"]\n[model.params]\na = 0.2\n' + RUN,
    "kinks": '[model]\nH = "p**2/2 + Max(q, a*q**2) + Piecewise((q**2, (q < 0) | (q >= 1)), (atan2(q, 2), True))"\n'
    'noise = ["0.1*Abs(q)"]\n[model.params]\na = 0.5\n' + RUN + 'scheme = "stormer_verlet"\n',
    "wall_chain": '[model]\nH = "Sum(p[i]**2/2, i) + Sum(log(cosh(q[i+1]-q[i])) + sech(q[i]), i)"\nn = 5\n' + RUN,
    "options": '[model]\nH = "(p1**2+p2**2)/2 + q1**2*q2 + (q1**2+q2**2)/2"\nnoise = ["s*q1", "s*q2"]\n'
    "[model.params]\ns = 0.2\n" + RUN + 'refine = 1\nfirst_path = 256\nfirst_step = 4\nt0 = 0.5\ncommon_noise = [2]\n'
    'compensated = true\ntruncation = [2.0, 1.0]\nscheme = "stormer_verlet"\n',
    "builtin": '[model]\nname = "synchrotron"\nsigma1 = 0.3\n' + RUN + 'general = true\ncorrection = "none"\n',
    "chain": '[model]\nH = "Sum(p[i]**2/2, i) + Sum(cosh(q[i+1]-q[i]), i)"\nnoise = ["-s*q[k]"]\nn = 9\n'
    'ends = "fixed"\n'
    "[model.params]\ns = 0.2\n" + RUN,
    # couplings to both sides across the ends, products of q and p, noises of single sites before and after one of all
    # sites
    "ring": '[model]\nH = "Sum((q[i+1]-q[i])**2/2 + (p[i+2]-p[i-1])**2*E/8 + g*(q[i]**2+p[i]**2)**2/4*cos(t), i)"\n'
    'noise = ["s*Sum(q[i]*p[i+1], i)", "s*q[k]", "s*p[k]", "Sum(s*cos(q[i])*log(2+p[i]**2)**E, i)"]\nn = 7\n'
    'ends = "periodic"\n[model.params]\ng = 0.7\nE = 1.3\ns = 0.2\n'
    + RUN.replace("q0 = 0.4", f"q0 = {[0.1*k for k in range(7)]}"),
    "toda": '[model]\nH = "Sum(p[i]**2/2, i) + Sum(exp(q[i+1]-q[i]), i)"\nnoise = ["Sum(s*q[i], i)"]\nn = 12\n'
    '[model.params]\ns = 0.2\n' + RUN.replace("q0 = 0.4", f"q0 = {[k/16 for k in range(12)]}")
    + 'scheme = "stormer_verlet"\n',
    # kicks by functions of the actions between flows of a quadratic part
    "lattice": '[model]\nH = "(q1**2+p1**2)**2/4 + (q2**2+p2**2)**2/4 - J*(q1*q2+p1*p2) + q1*p2/8"\n'
    'noise = ["s*(q1**2+p1**2)*(q2**2+p2**2)", "s*(q2**2+p2**2)"]\n[model.params]\nJ = 0.7\ns = 0.3\n'
    + RUN + 'scheme = "gauss_dkdkd"\n',
    # noises of phases, whose brackets are bonds of the quadratic part
    "phases": '[model]\nH = "(q1**2+p1**2)**2/4 + (q2**2+p2**2)**2/4 - J*(q1*q2+p1*p2) + q1*p2/8"\n'
    'noise = ["s*(q1**2+p1**2)*cos(t)", "s*(q2**2+p2**2 - q1**2-p1**2)"]\n[model.params]\nJ = 0.7\ns = 0.3\n'
    + RUN + 'scheme = "gauss_dkdkd_strong2"\n',
    # functions that C or Fortran computes lane by lane, and series where it lacks them
    "special": '[model]\nH = "p**2/2 + q**2/2 + loggamma(q**2+0.3) + gamma(-q**2/9-0.1)/50 + besselj(2, q)'
    ' + bessely(1, q**2+2)"\n'
    'noise = ["0.1*besseli(3, -2*q)", "0.2*besselk(2, q**2+1)*besseli(0, q)", "0.1*loggamma(2 + cos(q))"]\n'
    + RUN + 'scheme = "midpoint"\n',
    # pairs, sites of several coordinates, numbers of sites, noises of each site before others
    "bodies": '[model]\nH = "Sum((u[i]**2+v[i]**2+w[i]**2)/(2*m[i]) + log(cosh(x[i])), i)'
    ' - Sum(G*m[i]*m[j]/sqrt((x[i]-x[j])**2+(y[i]-y[j])**2+(z[i]-z[j])**2+eps**2), i < j)"\n'
    'noise = ["s*x[k]", "s*v[k]*y[k]*m[k]", "Sum(cos(x[i] - z[j])*m[j] + w[i]*w[j], i < j)/5"]\n'
    'q = "x y z"\np = "u v w"\nn = 4\n[model.params]\nm = [0.5, 0.8, 1.1, 1.4]\nG = 1.1\neps = 0.4\ns = 0.1\n'
    + RUN.replace("q0 = 0.4", f"q0 = {[0.3*k for k in range(12)]}"),
    "springs": '[model]\nH = "Sum(p[i]**2/2 + r*q[i]**2/2, i)'
    ' + Sum(K[i]*(q[i+1]-q[i])**4/4 + b[i+1]*q[i]**2*q[i+1], i)"\n'
    'noise = ["s[a]*q[a]"]\nn = 12\nends = "periodic"\n[model.params]\n'
    f'b = {[0.1 + k/50 for k in range(12)]}\nr = 0.4\nK = {[1.5]*12}\ns = {[0.2 - k/100 for k in range(12)]}\n'
    + RUN.replace("q0 = 0.4", f"q0 = {[k/16 for k in range(12)]}"),
    # kicks by functions of q beside a part that is found, and beside one by hand of sums over sites
    "trap": '[model]\nH = "(p1**2+p2**2)/2 + W*(q2*p1-q1*p2) + W**2*(q1**2+q2**2)/2 + q1**4/4"\n'
    'noise = ["s*sin(q1)", "s*q2"]\n[model.params]\nW = 1.5\ns = 0.3\n' + RUN + 'scheme = "chin4a"\n',
    "stiff_chain": '[model]\nH = "Sum(p[i]**2/2, i) + Sum(k*(q[i+2]-q[i])**2/2 + cos(q[i+1]-q[i]), i)"\n'
    'noise = ["s*q[j]"]\nn = 6\nends = "fixed"\nsplit = "Sum(p[i]**2/2, i) + Sum(k*(q[i+2]-q[i])**2/2, i)"\n'
    '[model.params]\nk = 90.0\ns = 0.2\n' + RUN + 'scheme = "gauss_dkdkd"\n',
    # brackets by third derivatives, since differences of gradients give other numbers
    "third": '[model]\nH = "(x**2+u**2)*(y**2+v**2)/8 + a*cos(x-y)*u"\nnoise = ["s*sin(x)*v", "s*y*u**2"]\n'
    'q = ["x", "y"]\np = ["u", "v"]\n[model.params]\na = 0.9\ns = 0.4\n' + RUN + 'scheme = "gauss2_strong32"\n',
}  # fmt: skip


SITES = [name for name in SCENES if "Sum(" in SCENES[name]]


def export(folder, name, language, capsys):
    """The line that compiles a scene exported as a program."""
    (folder / f"{name}.toml").write_text(SCENES[name])
    ending = {"fortran": "f90", "c": "c"}[language]
    target = folder / f"{name}.{ending}"
    assert command_line.main(["export", str(folder / f"{name}.toml"), "--to", language, "--out", str(target)]) == 0
    text = target.read_text()
    assert text.endswith("\n") and not text.endswith("\n\n")
    return capsys.readouterr().out.strip(), text


def numbers(folder, line, name):
    """Output of the program, as numbers. The line as it is compiles programs that are called names, and without the
    optimiser all others."""
    subprocess.run(line if name == "names" else line.replace(" -O2 ", " -O0 "), shell=True, check=True, cwd=folder)
    done = subprocess.run([f"./{name}"], check=True, cwd=folder, capture_output=True, text=True)
    return np.array([[float(x) for x in row.split()] for row in done.stdout.splitlines()[1:]])


@pytest.mark.parametrize("noises", [(1,), (2, 63), (1, 64), tuple(range(1, 65))])
def test_common_noises_are_numbers_in_fortran(noises):
    """Common noises up to the last possible one, whose bit is the sign bit of signed integers."""
    assert in_fortran._option("common_noise", sum(1 << (k - 1) for k in noises)) == str(list(noises))


CASES = [(name, language) for name in SCENES for language in ("c", "fortran")]


@pytest.mark.usefixtures("quick_compiler")
@pytest.mark.parametrize(("name", "language"), CASES)
def test_programs_give_the_numbers_of_the_scene(name, language, tmp_path, capsys):
    if language == "fortran" and shutil.which("gfortran") is None:
        pytest.skip("no gfortran")
    line, text = export(tmp_path, name, language, capsys)
    assert line in text
    if language == "fortran":
        assert name in SITES or max(len(row) for row in text.splitlines() if line not in row) <= 132
    else:
        code, checked = scene.load(tmp_path / f"{name}.toml").model, ["-std=c11", "-Wall", "-Werror", "-fsyntax-only"]
        assert getattr(code, "formula", None) is None or code.formula.source in text  # what runs in Python, and no more
        subprocess.run(["cc", *checked, f"-I{HEADERS}", f"{name}.c"], check=True, cwd=tmp_path)
    found = numbers(tmp_path, line, name)
    known = moments_of(scene.load(tmp_path / f"{name}.toml"))
    n = known.mean_q.shape[1]
    columns = np.concatenate([known.mean_q, known.mean_p, known.mean_energy[:, None]], axis=1)
    errors = np.concatenate([known.se_mean_q, known.se_mean_p, known.se_mean_energy[:, None]], axis=1)
    assert found.shape == (3, 1 + 2 * (2 * n + 1))
    np.testing.assert_allclose(found[:, 0], known.t, rtol=1e-15)
    np.testing.assert_allclose(found[:, 1::2], columns, rtol=1e-11, atol=1e-11)
    np.testing.assert_allclose(found[:, 2::2], errors, rtol=1e-9, atol=1e-11)


@pytest.mark.parametrize("language", ["c", "fortran"])
def test_chains_of_any_length_are_the_same_program(language, tmp_path, capsys):
    """Programs differ in the number of sites alone; the Fortran program also runs with a chain of a hundred thousand
    sites."""
    H = "Sum(p[i]**2/2, i) + Sum((q[i+1]-q[i])**2/2 + b*(q[i+1]-q[i])**4/4, i)"
    SCENES["short"] = f'[model]\nH = "{H}"\nnoise = ["Sum(s*q[i], i)"]\nn = 40\nends = "fixed"\n'
    SCENES["short"] += "[model.params]\nb = 0.7\ns = 0.2\n" + RUN.replace("40", "2").replace("20", "2").replace(
        "30", "2"
    )
    SCENES["long"] = SCENES["short"].replace("n = 40", "n = 100000")
    short = export(tmp_path, "short", language, capsys)[1]
    line, text = export(tmp_path, "long", language, capsys)
    for sites, few in ((" 100000", " 40"), (" 200001", " 81"), ("long", "short")):
        text = text.replace(sites, few)
    assert text == short
    if language == "c" or shutil.which("gfortran") is None:
        return
    found = numbers(tmp_path, line, "long")
    known = moments_of(scene.load(tmp_path / "long.toml"))
    np.testing.assert_allclose(found[1, 1:200001:2], known.mean_q[1], rtol=1e-12)
    np.testing.assert_allclose(found[1, 200001:400001:2], known.mean_p[1], rtol=1e-12)


def test_the_program_is_written_from_the_formulas(tmp_path, capsys):
    """The twin: another parameter in the program gives other numbers."""
    line, text = export(tmp_path, "names", "c", capsys)
    assert "H = double**2/2*A0 - cos(E*q)*a0" in text
    assert "      1.2, /* c0: A0 */\n" in text
    (tmp_path / "names.c").write_text(text.replace("1.2, /* c0: A0 */", "1.212, /* c0: A0 */"))
    found = numbers(tmp_path, line, "names")
    known = moments_of(scene.load(tmp_path / "names.toml"))
    assert abs(found[-1, 1] - known.mean_q[-1, 0]) > 1e-4


def test_no_text_of_a_scene_reaches_the_code(tmp_path, capsys):
    """Comments in formulas follow Python's syntax and names are arbitrary: neither ends a comment nor begins a line."""
    text = SCENES["names"].replace('H = "', "H = '''(p**2/2 # */ int evil; /*\n + q**2/2) #''' #")
    text = text.replace('q = "q"\np = "double"\n', 'name = "x*/\\" ; evil"\n').replace('*double"', '"')
    SCENES["hostile"] = text
    for language in ("c", "fortran"):
        text = export(tmp_path, "hostile", language, capsys)[1]
        assert "evil" in text  # in a string literal, without its quotation mark
        assert "int evil" not in text and '"x*/' not in text and "' ;" not in text and '" ;' not in text
    assert given.harmless("a */ b\n /* c # d\n*/*/") == "a * / b / * c * /* /".replace("/* /", "/ * /")


def test_names_that_fortran_takes():
    """Parameters are components of a type, so that only names of the model's own are reserved."""
    names = ["omega", "double", "I", "A", "a", "q1", "self", "EOF", "9x", "a-b", "h" * 40, "ü", "value", "Traits"]
    made = given.identifiers(names)
    good = ("omega", "double", "I", "A", "q1", "self", "EOF")
    assert all(made[x] == (x if x in good else f"parameter_{names.index(x) + 1}") for x in names)
    text = (ROOT / "src" / "model" / "abstract.f90").read_text().partition("abstract :: model_type")[2]
    body = text.partition("end type")[0]
    members = re.findall(r"^ +(?:procedure.*|(?:type|class)\(.*|character.*):: (\w+)", body, re.M)
    assert len(members) > 10 and set(members) == given._TAKEN


@pytest.mark.parametrize("names", [["parameter_2", "value"], ["name", "parameter_1"], ["Parameter_2", "a-b"]])
def test_names_that_are_made_are_nobody_elses(names):
    assert len({x.lower() for x in given.identifiers(names).values()}) == 2


@pytest.mark.parametrize(
    ("text", "language", "words"),
    [
        (
            SCENES["toda"].replace("(p[i]**2/2, i)", "(p[i], i)**2"),
            "fortran",
            "of sums over sites are exported to C only",
        ),
        (SCENES["builtin"].replace("q0 = 0.4", f"q0 = [{[0.1] * 30}]"), "c", "differ from path to path"),
        ('[model]\npython = "m:f"\n' + RUN, "c", "a Python function cannot be exported: give formulas"),
    ],
)
def test_what_cannot_be_exported_gets_a_sentence(text, language, words, tmp_path, capsys):
    file = tmp_path / "scene.toml"
    file.write_text(text)
    out = tmp_path / f"out.{'f90' if language == 'fortran' else 'c'}"
    assert command_line.main(["export", str(file), "--to", language, "--out", str(out)]) == 2
    assert words in capsys.readouterr().err and not out.exists()
    assert command_line.main(["export", str(file), "--to", language, "--out", str(tmp_path / "out.txt")]) == 2
    assert "ends in" in capsys.readouterr().err
    for name in ("a b.c", "a;b.c", "1.c", "a\nb.c", "$(x).c"):
        assert command_line.main(["export", str(file), "--to", "c", "--out", str(tmp_path / name)]) == 2
        assert "name programs by a letter" in capsys.readouterr().err


def test_parentheses_keep_the_order_of_operations():
    graph = Graph()
    a, b, c = (graph.leaf(name, True) for name in "abc")
    both, product = graph.sum([b, c]), graph.multiply(b, c)
    cases = {
        graph.node("-", a, both): "a - (b + c)",
        graph.node("+", a, both): "a + (b + c)",
        graph.node("/", a, product): "a/(b*c)",
        graph.node("*", both, graph.node("/", a, b)): "(b + c)*(a/b)",
        graph.negative(both): "-(b + c)",
        graph.node("-", a, graph.negative(product)): "a - (-b*c)",
        graph.node("sin", both): "sin(b + c)",
        graph.multiply(graph.number(2.0), both): "(b + c)*2.0",
    }
    for node, text in cases.items():
        assert Expressions(graph, [node], str, str).results == [text]


def test_what_programs_leave_out_is_said(tmp_path, capsys):
    file = tmp_path / "a.toml"
    text = '[model]\nname = "kubo"\n[run]\nstep = 0.1\nsteps = 2\nq0 = 1.0\np0 = 0.0\n'
    more = '[output]\npaths = [0]\n[observables]\nr = "q**2"\n[[observe]]\nkind = "covariance"\nof = ["q_1", "r"]\n'
    for given_text, said in ((text, ""), (text + more, "H alone: [observables], [[observe]], paths of [output]\n")):
        file.write_text(given_text)
        assert command_line.main(["export", str(file), "--to", "c", "--out", str(tmp_path / "a.c")]) == 0
        error = capsys.readouterr().err
        assert error.endswith(said) and bool(error) == bool(said)
