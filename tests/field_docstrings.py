"""What stands under the fields of a class, for documents that are checked against it."""

import ast
import inspect
import textwrap

from pydantic import BaseModel


def docstrings_of(described: type) -> dict[str, str]:
    """Field -> the docstring under it, on one line; with those of the class that it extends."""
    found = docstrings_of(described.__base__) if described.__base__ not in (None, object, BaseModel) else {}
    (node,) = ast.parse(textwrap.dedent(inspect.getsource(described))).body
    assert isinstance(node, ast.ClassDef)
    for statement, after in zip(node.body, node.body[1:], strict=False):
        if (
            isinstance(statement, ast.AnnAssign)
            and isinstance(statement.target, ast.Name)
            and isinstance(after, ast.Expr)
            and isinstance(after.value, ast.Constant)
        ):
            found[statement.target.id] = " ".join(str(after.value.value).split())
    return found
