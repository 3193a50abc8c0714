"""From Modelica to sorted equations: what is understood is understood right, the rest is refused by name."""

import fmpy
import numpy as np
import pytest
import sympy as sp

from lpfcosim.modelica import build
from lpfcosim.modelica.flat_model import UnsupportedError
from tests.lpfcosim.modelica.modelica_source import fmu, translate, write

pytestmark = pytest.mark.fmu

LIBRARY = build.PACKAGE.parent
SOURCES = [file for folder in build.packages() for file in sorted(folder.rglob("*.mo"))]


def value(system, name, **numbers):
    """Evaluate the algebraic variable or derivative ``name`` of a system at ``numbers``."""
    known = {sp.Symbol(k, real=True): v for k, v in numbers.items()}
    for symbol, expression in (*system.calculated, *system.algebraic, *system.derivatives):
        known[symbol] = expression.xreplace(known) if symbol not in known else known[symbol]
        if symbol.name == name:
            return float(expression.xreplace(known))
    raise KeyError(name)


@pytest.mark.parametrize("file", SOURCES, ids=lambda p: p.name)
def test_file_stands_alone_where_tools_look_for_it_and_parses_with_another_front_end(file):
    text = file.read_text(encoding="utf-8")
    assert "Modelica." not in text
    folder, name = file.parent, file.stem
    if name == "package":
        folder, name = folder.parent, folder.name
    assert f"end {name};" in text
    if folder != LIBRARY:
        assert text.startswith(f"within {'.'.join(folder.relative_to(LIBRARY).parts)};\n")
        assert name in (folder / "package.order").read_text().split()
    scope = pytest.importorskip("pymoca.parser").parse(text)
    for part in (*folder.relative_to(LIBRARY).parts, name):
        scope = scope.classes[part]


def test_algebraic_loop_is_solved(tmp_path):
    system = translate(
        tmp_path,
        """model M
          input Real u; output Real y; Real z; parameter Real k = 3;
        equation
          y + k*z = u;
          k*y - z = 2;
        end M;""",
    )
    a = np.array([[1.0, 3.0], [3.0, -1.0]])
    expected = np.linalg.solve(a, [0.7, 2.0])
    assert value(system, "y", u=0.7, k=3.0) == pytest.approx(expected[0], rel=1e-15)
    assert value(system, "z", u=0.7, k=3.0) == pytest.approx(expected[1], rel=1e-15)


A = np.array([[1.0, 2, 3], [0, 4, 5], [-1, 0, 6]])
V, W = np.array([0.3, -1.2, 2.5]), np.array([-0.7, 0.2, 1.1])
EXPRESSIONS = {
    "A*v": A @ V,
    "transpose(A)*v + 2*v": A.T @ V + 2 * V,
    "cross(v, w)": np.cross(V, W),
    "v .* w ./ {1, 2, 4}": V * W / np.array([1, 2, 4]),
    "fill(v*w, 3) - w": np.full(3, V @ W) - W,
    "cat(1, {v[2]}, w[1:2])": [V[1], W[0], W[1]],
    "{sin(v[1]), exp(-v[2]^2), sqrt(abs(w[3]))}": [np.sin(V[0]), np.exp(-(V[1] ** 2)), np.sqrt(W[2])],
    "v*(if v[1] > 0 and w[2] < 1 then 1 else -1)": V,
    "{max(v[1], w[1]), min(v), sum(w)}": [max(V[0], W[0]), V.min(), W.sum()],
    "twice(v)": 2 * V,
    "identity(3)*v + diagonal(w)*v": V + W * V,
    "{atan2(v[1], v[2]), tanh(v[3]), -(v[1] - 2)^3}": [np.arctan2(*V[:2]), np.tanh(V[2]), (2 - V[0]) ** 3],
    "{4*atan(1.0), exp(1.0), log10(1000.0)}": [np.pi, np.e, 3.0],
}


def test_expressions_against_numpy(tmp_path):
    outputs = "".join(f"output Real y_{k}[3];" for k in range(len(EXPRESSIONS)))
    equations = "".join(f"y_{k} = {expression};" for k, expression in enumerate(EXPRESSIONS))
    archive = fmu(
        tmp_path,
        f"""function twice
          input Real v[3]; output Real y[3];
        algorithm
          for i in 1:3 loop y[i] := 2*v[i]; end for;
        end twice;
        model M
          parameter Real A[3, 3] = [1, 2, 3; 0, 4, 5; -1, 0, 6];
          input Real v[3](start = {{0.3, -1.2, 2.5}}); input Real w[3](start = {{-0.7, 0.2, 1.1}});
          {outputs}
        equation
          {equations}
        end M;""",
    )
    result = fmpy.simulate_fmu(str(archive), stop_time=0.1, output_interval=0.1)
    for k, (expression, expected) in enumerate(EXPRESSIONS.items()):
        values = [result[f"y_{k}[{i}]"][-1] for i in (1, 2, 3)]
        np.testing.assert_allclose(values, expected, rtol=1e-14, err_msg=expression)


def test_affine_systems_are_recognised(tmp_path):
    head = "model M Real x; Real y; input Real u; parameter Real k = 2; equation der(x) = y;"
    assert translate(tmp_path, f"{head} der(y) = -k^2*x + u; end M;").affine is not None
    assert translate(tmp_path, f"{head} der(y) = -k^2*sin(x) + u; end M;").affine is None
    assert translate(tmp_path, f"{head} der(y) = -k*u/x; end M;").affine is None
    assert translate(tmp_path, f"{head} der(y) = -x + time; end M;").affine is None


REFUSED = {
    "nonlinear equation for x": ("output Real x; input Real u;\nequation\n  x^3 + x = u;", 3),
    "event inside a step": ("Real x; input Real u;\nequation\n  der(x) = if x > 1 then 0 else u;", 3),
    "depend on each other in a circle": ("discrete Real x; discrete Real y; input Real u;\nequation\n"
                                         "  when sample(0, 0.1) then\n    x = y + u;\n    y = 2*x;\n"
                                         "  end when;", None),
    "pre() outside when": ("discrete Real n(start = 0); output Real y;\nequation\n  y = pre(n);\n"
                           "  when sample(0, 0.1) then\n    n = pre(n) + 1;\n  end when;", 3),
    "pre(x) of a variable that is not sampled": ("Real x; discrete Real n;\nequation\n  der(x) = 1;\n"
                                                 "  when sample(0, 1) then\n    n = pre(x);\n  end when;", 5),
}  # fmt: skip


@pytest.mark.parametrize("construct", REFUSED)
def test_unsupported_construct_is_refused_with_its_place(tmp_path, construct):
    body, line = REFUSED[construct]
    text = f"model M {body}\nend M;\n"
    with pytest.raises(
        UnsupportedError, match=construct.strip().replace("(", r"\(").replace(")", r"\)")
    ) as caught:
        build.build_one(write(tmp_path, text), "M", tmp_path / "M.fmu")
    if line is not None:
        assert f"Test.mo:{line}: M: " in str(caught.value)
    assert not (tmp_path / "M.fmu").exists()
