"""Mutants that the syntax of a file suggests: each comparison, condition, number, sum and statement, changed alone."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path
from typing import Final

from tests.mutants.mutant import HELD_BY, Mutant

_COMPARE: Final[dict[type[ast.cmpop], tuple[type[ast.cmpop], ...]]] = {
    ast.Lt: (ast.LtE, ast.GtE),
    ast.LtE: (ast.Lt, ast.Gt),
    ast.Gt: (ast.GtE, ast.LtE),
    ast.GtE: (ast.Gt, ast.Lt),
    ast.Eq: (ast.NotEq,),
    ast.NotEq: (ast.Eq,),
    ast.Is: (ast.IsNot,),
    ast.IsNot: (ast.Is,),
    ast.In: (ast.NotIn,),
    ast.NotIn: (ast.In,),
}
_ARITHMETIC: Final[dict[type[ast.operator], type[ast.operator]]] = {
    ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.Div, ast.Div: ast.Mult, ast.Mod: ast.Mult, ast.BitAnd: ast.BitOr,
    ast.BitOr: ast.BitAnd, ast.LShift: ast.RShift, ast.RShift: ast.LShift, ast.Pow: ast.Mult, ast.FloorDiv: ast.Mult,
}  # fmt: skip
_CALLS: Final = {"min": "max", "max": "min", "any": "all", "all": "any", "sorted": "list"}
_LEFT_OUT: Final = {"shape", "shown", "final", "measures"}
"""Functions that only report."""


class _Finder(ast.NodeVisitor):
    """Collects (node, text in its place)."""

    def __init__(self) -> None:
        self.found: list[tuple[ast.AST, str]] = []

    def _say(self, node: ast.AST, other: ast.AST) -> None:
        self.found.append((node, f"({ast.unparse(other)})"))

    def visit_FunctionDef(self, node: ast.FunctionDef) -> None:
        """The body alone: neither annotations nor decorators state a rule. Defaults do."""
        if node.name not in _LEFT_OUT:
            for child in [*node.body, *node.args.defaults]:
                self.visit(child)

    def visit_AnnAssign(self, node: ast.AnnAssign) -> None:
        """The value alone."""
        if node.value is not None:
            self.visit(node.value)

    def visit_Compare(self, node: ast.Compare) -> None:
        """`<` becomes `<=`, and its opposite; and so on."""
        for place, operator in enumerate(node.ops):
            for other in _COMPARE[type(operator)]:
                operators = [*node.ops[:place], other(), *node.ops[place + 1 :]]
                self._say(node, ast.Compare(node.left, operators, node.comparators))
        self.generic_visit(node)

    def visit_BoolOp(self, node: ast.BoolOp) -> None:
        """`and` becomes `or`; and each operand is left out."""
        self._say(node, ast.BoolOp(ast.Or() if isinstance(node.op, ast.And) else ast.And(), node.values))
        for place in range(len(node.values)):
            left = [*node.values[:place], *node.values[place + 1 :]]
            self._say(node, left[0] if len(left) == 1 else ast.BoolOp(node.op, left))
        self.generic_visit(node)

    def visit_UnaryOp(self, node: ast.UnaryOp) -> None:
        """`not x`, `-x` and `~x` become `x`."""
        self._say(node, node.operand)
        self.generic_visit(node)

    def visit_BinOp(self, node: ast.BinOp) -> None:
        """A sum becomes a difference, and so on."""
        if type(node.op) in _ARITHMETIC:
            self._say(node, ast.BinOp(node.left, _ARITHMETIC[type(node.op)](), node.right))
        self.generic_visit(node)

    def visit_Constant(self, node: ast.Constant) -> None:
        """Another number; the opposite of True and False."""
        if isinstance(node.value, bool):
            self._say(node, ast.Constant(not node.value))
        elif isinstance(node.value, (int, float)):
            self._say(node, ast.Constant(node.value + 1))

    def visit_Call(self, node: ast.Call) -> None:
        """`min` becomes `max`, and so on."""
        if isinstance(node.func, ast.Name) and node.func.id in _CALLS:
            self._say(node, ast.Call(ast.Name(_CALLS[node.func.id]), node.args, node.keywords))
        self.generic_visit(node)

    def visit_IfExp(self, node: ast.IfExp) -> None:
        """Always the one, always the other."""
        self._say(node, node.body)
        self._say(node, node.orelse)
        self.generic_visit(node)

    def visit_If(self, node: ast.If) -> None:
        """The condition always holds, and never."""
        for value in (True, False):
            self._say(node.test, ast.Constant(value))
        self.generic_visit(node)

    def _drop(self, node: ast.stmt) -> None:
        self.found.append((node, "pass"))
        self.generic_visit(node)

    def visit_Expr(self, node: ast.Expr) -> None:
        """A call is left out; a docstring says nothing."""
        if not isinstance(node.value, ast.Constant):
            self._drop(node)

    def visit_Assign(self, node: ast.Assign) -> None:
        """A change of an object is left out; without a local name nothing would run."""
        if any(isinstance(target, (ast.Attribute, ast.Subscript)) for target in node.targets):
            self._drop(node)
        else:
            self.generic_visit(node)

    visit_AugAssign = visit_Continue = visit_Break = visit_Delete = _drop  # noqa: N815  # the names of ast


def generated(root: Path, path: str) -> Iterator[Mutant]:
    """All mutants of a file, in the order of its text."""
    text = (root / path).read_text(encoding="utf-8")
    assert text.isascii(), "columns of the syntax tree are bytes"
    finder = _Finder()
    finder.visit(ast.parse(text))
    starts = [0]
    for line in text.splitlines(keepends=True):
        starts.append(starts[-1] + len(line))
    for node, new in sorted(finder.found, key=lambda found: (found[0].lineno, found[0].col_offset)):  # type: ignore[attr-defined]
        assert isinstance(node, (ast.expr, ast.stmt))
        assert node.end_lineno is not None
        assert node.end_col_offset is not None
        start, end = starts[node.lineno - 1] + node.col_offset, starts[node.end_lineno - 1] + node.end_col_offset
        old = " ".join(text[start:end].split())
        yield Mutant(path, start, end, new, f"{path}:{node.lineno}: `{old}` becomes `{new}`", HELD_BY[path])
