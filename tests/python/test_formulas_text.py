# SPDX-License-Identifier: BSD-3-Clause
"""Formulas as text: their meaning, 200 hostile texts, scenes with formulas."""

import os

import numpy as np
import pytest
import symsde as ss
from clock import calls_of
from conftest import moments_of
from symsde import errors
from symsde.batch import scene
from symsde.cli import command_line

sp = pytest.importorskip("sympy")

from symsde.model.formulas import compiler  # noqa: E402
from symsde.model.formulas.parse import FormulaTextError, parse  # noqa: E402

q, p, w = sp.symbols("q p omega", real=True)
NAMES = {"q": q, "p": p, "omega": w}

MEANINGS = {
    "p**2/2 - omega**2*cos(q)": p**2 / 2 - w**2 * sp.cos(q),
    "-q**2": -(q**2),
    "(-q)**2": q**2,
    "2**-1*q": q / 2,
    "q/2/3": q / 6,
    "q - p - 1": q - p - 1,
    "q/(p/2)": 2 * q / p,
    "1/3*q + 0.1*p": q / 3 + sp.Float(0.1) * p,
    "q**(1/2)": sp.sqrt(q),
    "2*pi*q": 2 * sp.pi * q,
    "+q": q,
    "exp(-q**2)*tanh(p)": sp.exp(-(q**2)) * sp.tanh(p),
    "1e20*q": sp.Float(1e20) * q,
    "  q\n": q,
    "sin(1)*q": sp.Float(np.sin(1.0)) * q,
    "+".join(["q"] * 900): 900 * q,
}


@pytest.mark.parametrize("text", MEANINGS)
def test_a_text_means_what_it_says(text):
    assert sp.simplify(parse(text, NAMES) - MEANINGS[text]) == 0


CODE = """__import__('os').system('touch hostile')
exec("open('hostile','w')")
eval("1")
open('hostile', 'w')
q.__class__
q.__class__.__mro__[1].__subclasses__()
().__class__.__bases__[0]
(lambda: q)()
lambda q: q
[q for q in (1, 2)]
{q: p for q in p}
{q}
[q, p]
(q, p)
q, p
q if p else 1
q and p
not q
q or p
q < p
q == p
q != p
q in p
q is p
q := 1
(q := 1)
q; p
q = 1
import os
from os import system
print(q)
globals()
locals()
vars(q)
getattr(q, 'diff')
setattr(q, 'x', 1)
type(q)
compile('1', '', 'eval')
input()
help()
exit()
quit()
breakpoint()
f'{q}'
f"{__import__('os').system('touch hostile')}"
'q'
"q" * 10**9
b'q'
q[0]
q[1:2]
q[i+1]
*q
**q
q @ p
q % p
q // p
q & p
q | p
q ^ p
q << p
q >> p
~q
await q
yield q
yield from q
async for q in p: pass
q.real
q.diff(p)
cos.__globals__
sin.__init__
cos
sin + q
cos(q, p)
cos()
cos(q)(p)
cos(x=q)
cos(*q)
cos(**q)
sin[q]
Sum(q, i)
Symbol('x')
sympify('1')
S(1)
Function('f')(q)
Integral(q, q)
Derivative(q, q)
Matrix([[q]])
max(q, p)
trunc(q)
zeta(q)
I*q
oo*q
nan*q
None
True
False
True*q
...
Ellipsis
__debug__
1j
1j*q
q + 2j
nan
inf
E*q
x*y
omegga*q
Q
P**2
µ*q
q２*p
ｑ\u200b
π*r
system
os
self""".splitlines()
SIZES = [
    "9**9**9",
    "9**9**9**9",
    "2**(10**9)",
    "2**1000000",
    "q**1000000",
    "q**(10**6)",
    "q**33",
    "q**-33",
    "q**(2**31)",
    "(q+p)**1000",
    "1e999",
    "1e999*q",
    "-1e999",
    "1e308*1e308",
    "1e308**2*q",
    "10.0**400",
    "exp(1000)*q",
    "exp(exp(10))",
    "9007199254740993*q",
    "9" * 400 + "*q",
    "9" * 5000 + "*q",
    "0x" + "f" * 5000,
    "1" * 19_000,
    "q" * 20_001,
    "q+" * 10_001 + "q",
    "+".join(f"{i}*q" for i in range(2000)),
    "+".join(["q"] * 4001),
    "*".join(f"(q+{i})" for i in range(150)),
    "*".join(f"(q+{i})" for i in range(21)),
    "*".join(["q"] * 3000),
    "/".join(["q"] * 100),
    "(" * 300 + "q" + ")" * 300,
    "(" * 5000 + "q" + ")" * 5000,
    "(" * 5000,
    "[" * 5000,
    "-" * 5000 + "q",
    "+" * 41 + "q",
    "not " * 2000 + "q",
    "sin(" * 90 + "q" + ")" * 90,
    "sin(" * 41 + "q" + ")" * 41,
    "exp(" * 3000 + "q" + ")" * 3000,
    "q**q" + "**q" * 60,
    "(((q**2+1)**2+1)" + "**2+1)" * 45,
    "q" + "()" * 3000,
    "q" + "[0]" * 3000,
    "q" + ".x" * 3000,
    "lambda: " * 900 + "q",
    "q if q else " * 900 + "q",
]
NOT_REAL = [
    "1/0",
    "q/0",
    "0**-1*q",
    "q/(1-1)",
    "q/(2-1-1)",
    "sqrt(-1)",
    "sqrt(-2)*q",
    "(-1)**(1/2)",
    "(-1)**0.5*q",
    "(-8)**(1/3)*q",
    "log(0)",
    "log(-1)*q",
    "log(0*1)",
    "asin(2)*q",
    "acos(-3)",
    "acosh(0)",
    "atanh(1)",
    "atanh(2)*q",
    "sqrt(1-2)",
    "0/0",
    "0.0/0.0*q",
    "1/(0.1*0)",
    "sqrt(log(0.5))",
]
BROKEN = [
    "",
    "q +",
    "* q",
    "q p",
    "2q",
    "q)",
    "(q",
    "q..p",
    "q**",
    "**2",
    "q***p",
    "q//",
    "sin q",
    "sin(q",
    "cos(q))",
    "q,",
    ",",
    "=",
    "p**2/2 = q",
    "p^2/2",
    "p²/2",
    "'",
    '"""',
    "#",
    "# a comment alone",
    "q $ p",
    "q ? p",
    "q ! p",
    "@q",
    "\\",
    "q \\ p",
    "q",
    "  p",
    "0123",
    "1__0*q",
    "1e*q",
    "0b2",
    "∂q",
    "−q",
    "q·p",
    "q×p",
][1:]
HOSTILE = [
    *CODE,
    *SIZES,
    *NOT_REAL,
    "",
    " ",
    "\n",
    "\0",
    "q\0",
    "\ud800",
    *[x for x in BROKEN if x not in ("q", "  p")],
]


def test_there_are_enough_hostile_texts():
    assert len(set(HOSTILE)) >= 200


@pytest.mark.parametrize("text", sorted(set(HOSTILE), key=HOSTILE.index), ids=lambda text: ascii(text[:20]))
def test_hostile_texts_get_a_sentence_soon(text, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    said = ""

    def refused():
        nonlocal said
        with pytest.raises(errors.InvalidArgumentError) as caught:
            ss.model_from_sympy(text, q="q", p="p", params={"omega": 1.0})
        said = str(caught.value)

    assert calls_of(refused) < 1e7  # would take seconds
    assert said.startswith("the formula " + repr(text)[:60].rstrip("'\"")) and ": " in said and len(said) < 600
    assert not os.listdir(tmp_path)


def test_what_is_costly_but_allowed_is_derived_soon():
    from symsde.model.formulas import derivatives, named_formulas, structure

    def derived(text):
        given = named_formulas.make_problem(H=text, noise=[], q=None, p=None, params=None, t=None)
        structure.Prover(given).structure()
        derivatives.Derivatives(given)

    for text in (
        "sin(" * 38 + "q" + ")" * 38,
        "((q+p+1)**32+(q-p)**32)**32",
        "*".join(f"(q+p+{i})" for i in range(20)),
    ):
        assert calls_of(lambda text=text: derived(text)) < 1e7  # measured 3e6


def test_names_that_texts_could_not_mean():
    for name in ("sin", "pi", "a b", "2x", ""):
        with pytest.raises(errors.InvalidArgumentError, match="is no name for texts"):
            ss.model_from_sympy("p**2/2", params={name: 1.0})
    with pytest.raises(FormulaTextError, match="write sin"):
        parse("sin", NAMES)


needs_compiler = pytest.mark.skipif(compiler.command() is None, reason="no C compiler")


@pytest.mark.usefixtures("quick_compiler")
@needs_compiler
def test_texts_and_expressions_are_the_same_model():
    text = ss.model_from_sympy("p**2/2 - omega**2*cos(q)", ["sigma*sin(q)"], params={"omega": 2.0, "sigma": 0.2})
    s, o, x, y = sp.symbols("sigma omega x y")
    mine = ss.model_from_sympy(
        y**2 / 2 - o**2 * sp.cos(x), [s * sp.sin(x)], q=x, p=y, params={"omega": 2.0, "sigma": 0.2}
    )
    assert text.formula.source == mine.formula.source and text.formula.file == mine.formula.file


@pytest.mark.parametrize("first", ["q[0]", sp.IndexedBase("q")[0]])
def test_names_with_an_index_are_told_what_to_write(first):
    with pytest.raises(errors.InvalidArgumentError, match=r"'q\[0\]' has an index.* q1, q2, .*Sum\(q\[i\]"):
        ss.model_from_sympy("p**2/2", q=[first], p=["p"])


@pytest.mark.usefixtures("quick_compiler")
@needs_compiler
def test_coordinates_are_found_by_their_names():
    assert ss.model_from_sympy("(p1**2 + p2**2 + q1**2*q2)/2").ndof == 2
    assert ss.model_from_sympy("p1*q3", noise=["q2"]).ndof == 3
    named = ss.model_from_sympy("v**2/2 + x", q="x", p="v", t="s", invariants=["v**2/2 + x", "v + s"])
    assert list(named.formula.structure.invariants.items()) == [("v**2/2 + x", True), ("v + s", True)]


# ---- scenes ------------------------------------------------------------------------------------------------

SCENE = """
[model]
H = "p**2/2 - omega**2*cos(q)"
noise = ["sigma1*sin(q)", "-sigma2*cos(q)"]
[model.params]
omega = 2.0
sigma1 = 0.2
sigma2 = 0.1
[run]
step = 0.02
steps = 100
paths = 50
seed = 1
q0 = 0.5
p0 = 0.0
save_every = 50
[output]
paths = [0]
"""


@needs_compiler
def test_a_scene_with_formulas_is_that_of_the_catalogue(tmp_path):
    mine, known = tmp_path / "mine.toml", tmp_path / "known.toml"
    mine.write_text(SCENE)
    params = "omega = 2.0\nsigma1 = 0.2\nsigma2 = 0.1\n"
    known.write_text(f'[model]\nname = "synchrotron"\n{params}[run]' + SCENE.split("[run]")[1])
    first, second = (moments_of(scene.load(x)) for x in (mine, known))
    np.testing.assert_allclose(first.mean_energy, second.mean_energy, rtol=1e-13)
    assert command_line.main(["check", str(mine)]) == 0


@needs_compiler
def test_the_template_of_a_formula_runs(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert command_line.main(["template", "formula"]) == 0
    text = capsys.readouterr().out
    (tmp_path / "mine.toml").write_text(text.replace("5000", "100").replace("1000", "100"))
    assert command_line.main(["run", "mine.toml", "--quiet"]) == 0
    assert command_line.main(["study", "mine.toml", "--quiet", "--paths", "60", "--out", "study"]) in (0, 2)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("omega**2", "omegga", r"\[model\]: the formula 'p\*\*2/2 - omegga\*cos\(q\)' .* holds omegga"),
        ('"sigma1*sin(q)"', "3", "noise = .*: write formulas and names as text"),
        ("H =", "q = 1\nH =", "q = 1: give a text, or a list of texts"),
        ("H =", "Q = 1\nH =", "'Q' is no key beside H: there are"),
        ("omega = 2.0", 'omega = "2"', "the parameter omega = '2' is not a number"),
        ("cos(q)", "__import__('os')", "it calls __import__"),
        ("H =", 'python = "os:getcwd"\nG =', "say --allow-python"),
    ],
)
def test_bad_formulas_in_scenes(tmp_path, old, new, words):
    file = tmp_path / "scene.toml"
    file.write_text(SCENE.replace(old, new, 1))
    with pytest.raises(errors.SceneError, match=words):
        scene.load(file)


def test_python_models_only_where_allowed(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir("/")
    (tmp_path / "own_models_of_a_test.py").write_text(
        "import symsde as ss\ndef shaken(sigma):\n    open(__file__ + '.ran', 'w').close()\n"
        "    return ss.models.pendulum(sigma=sigma)\ndef wrong():\n    return 3\n"
    )
    file = tmp_path / "scene.toml"
    run = "[run]" + SCENE.split("[run]")[1]
    file.write_text('[model]\npython = "own_models_of_a_test:shaken"\nsigma = 0.25\n' + run)
    assert command_line.main(["check", str(file)]) == 2
    assert "--allow-python" in capsys.readouterr().err and not list(tmp_path.glob("*.ran"))
    assert command_line.main(["check", "--allow-python", str(file)]) == 0
    assert "pendulum(sigma=0.25)" in capsys.readouterr().out
    for named, words in (
        ("own_models_of_a_test:wrong", "is no model"),
        ("nowhere:at_all", "cannot be loaded: ModuleNotFoundError: No module named 'nowhere'"),
        ("json", "python = 'json': write module:function"),
    ):
        file.write_text(f'[model]\npython = "{named}"\n' + run)
        assert command_line.main(["check", "--allow-python", str(file)]) == 2
        assert words in capsys.readouterr().err


@pytest.mark.parametrize(
    ("H", "start", "sentence"),
    [
        ("p**2/2 + q^2", 0.4, "a power is written"),
        ("p**2/2 + ~q", 0.4, "it holds ~ or not"),
        ("p**2/2 + log(q)", -1.0, "a Hamiltonian or its derivative is not finite at q0 = -1"),  # the derivative is 1/q
        ("p**2/2 + q/t", 1.0, "not finite at q0 = 1, p0 = 0.3, t0 = 0: begin elsewhere"),
        ("p**2/2 + q**2", np.nan, "the initial state holds values that are not finite"),
        (sp.Symbol("p") ** 2 / 2 + sp.Integral(sp.Symbol("q"), sp.Symbol("q")), 0.4, "cannot be differentiated"),
        (
            sp.zeta(sp.Symbol("q") + 2) + sp.Symbol("p"),
            0.4,
            "zeta in a formula has no derivative",
        ),
        (sp.Integer(10) ** 400 * sp.Symbol("q"), 0.4, "the constant 1000000000000000000000000000000000000000 in"),
    ],
)
def test_what_a_sentence_says(H, start, sentence):
    with pytest.raises(errors.InvalidArgumentError, match=sentence):
        ss.simulate(ss.model_from_sympy(H), q0=start, p0=0.3, step=0.01, steps=2)


def test_a_time_that_is_none_is_called_by_its_name():
    """The message blames the time, not the Hamiltonian, which has no value then."""
    with pytest.raises(errors.InvalidArgumentError, match="t0 = NaN is not a time: give a finite number"):
        ss.simulate(ss.model_from_sympy("p**2/2 + t*q**2"), q0=0.4, p0=0.3, t0=np.nan, step=0.01, steps=2)


@pytest.mark.usefixtures("quick_compiler")
def test_names_of_generated_code_and_of_c_are_free():
    """The numbers do not depend on the parameters' names."""
    # Python reads the last name as another letter
    names = ["x19", "c0", "w0", "far", "beyond", "double", "while_", "E", "I", "S", "N", "q0", "p0", "λ", "ϕ"]
    terms = " + ".join(f"{name}*q**{k + 1}" for k, name in enumerate(names))
    values = {name: 0.1 * (k + 1) for k, name in enumerate(names)}
    mine = ss.model_from_sympy(f"p**2/2 + {terms}", params=values)
    expected = 0.3 + sum(0.1 * (k + 1) ** 2 * 0.9**k for k in range(len(names)))
    force, velocity = mine.gradient(0.9, 0.3)
    np.testing.assert_allclose([force[0, 0] + 0.3, velocity[0, 0]], [expected, 0.3], rtol=1e-14)
