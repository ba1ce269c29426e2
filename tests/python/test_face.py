"""The public face: everything is documented, the stubs name what there is, and nothing else."""
import ast
import inspect
import re
import unittest
from pathlib import Path

import toothprep
from module_test import SOURCE, main

STUBS = ast.parse((Path(toothprep.__file__).parent / "__init__.pyi").read_text())


def public(names):
    return {name for name in names if not name.startswith("_")}


def members(kind):
    """What a class of ours has beyond object, dict and Exception, __init__ apart."""
    own = set()
    for base in kind.__mro__:
        if base.__module__.startswith("toothprep"):
            own |= public(vars(base))
    return own


def stub_classes():
    return {node.name: node for node in STUBS.body if isinstance(node, ast.ClassDef)}


def stub_members(node):
    names = {n.name for n in node.body if isinstance(n, ast.FunctionDef)}
    names |= {n.target.id for n in node.body if isinstance(n, ast.AnnAssign)}
    return public(names)


def signature(text):
    """Argument names in a docstring's first line, as pybind11 writes it."""
    inside = text[text.index("(") + 1:text.rindex(")")]
    while re.search(r"[(\[][^()\[\]]*[)\]]", inside):  # default values and types
        inside = re.sub(r"[(\[][^()\[\]]*[)\]]", "", inside)
    names = [part.split(":")[0].split("=")[0].strip() for part in inside.split(",")]
    return [name for name in names if name not in ("", "*")]


class Face(unittest.TestCase):
    def test_everything_public_is_documented(self):
        self.assertTrue(toothprep.__doc__)
        for name in toothprep.__all__:
            item = getattr(toothprep, name)
            self.assertTrue(inspect.getdoc(item), name)
            if not inspect.isclass(item):
                continue
            for member in members(item):
                value = getattr(item, member)
                if callable(value) or isinstance(value, property):
                    text = inspect.getdoc(value) or ""
                    self.assertGreater(len(text.split("\n\n", 1)[-1]), 10, f"{name}.{member}")

    def test_all_names_what_there_is(self):
        there = {name for name in public(vars(toothprep)) if not inspect.ismodule(getattr(toothprep, name))}
        self.assertEqual(set(toothprep.__all__), there)

    def test_stubs_name_the_modules_names(self):
        stubs = {node.name for node in STUBS.body if isinstance(node, (ast.ClassDef, ast.FunctionDef))}
        self.assertEqual(stubs, set(toothprep.__all__))

    def test_stubs_name_the_members_of_every_class(self):
        for name, node in stub_classes().items():
            kind = getattr(toothprep, name)
            there = members(kind) | {"attributes"} if name == "Trace" else members(kind)
            if name in ("Error", "SizeError"):
                there = {"file", "place", "condition", "remedy"}
            if name == "SizeError":
                there = set()  # Error's
            if name == "Voxelized":
                there |= {"tooth"}
            if name == "Fit":
                there |= {"parameters_toml"}
            self.assertEqual(stub_members(node), there, name)

    def test_stubs_have_the_arguments_of_every_function(self):
        for node in STUBS.body:
            if not isinstance(node, ast.FunctionDef):
                continue
            stub = [a.arg for a in node.args.args + node.args.kwonlyargs]
            function = getattr(toothprep, node.name)
            try:
                there = list(inspect.signature(function).parameters)
            except ValueError:  # compiled
                there = signature(function.__doc__.split("\n")[0].split(" ->")[0])
            self.assertEqual(stub, there, node.name)

    def test_stubs_have_the_arguments_of_every_compiled_method(self):
        for name in ("Tooth", "Bur", "Session"):
            for node in stub_classes()[name].body:
                if not isinstance(node, ast.FunctionDef) or node.decorator_list:
                    continue
                stub = [a.arg for a in node.args.args + node.args.kwonlyargs][1:]
                line = getattr(getattr(toothprep, name), node.name).__doc__.split("\n")[0].split(" ->")[0]
                self.assertEqual(stub, signature(line)[1:], f"{name}.{node.name}")

    def test_records_have_the_traces_fields(self):
        fields = {name.replace("/", "_") for name, _, _ in toothprep._core.trace_columns()}
        self.assertEqual(members(toothprep.Record), fields)

    def test_package_says_that_it_is_typed(self):
        self.assertTrue((Path(toothprep.__file__).parent / "py.typed").exists())

    def test_the_page_names_every_public_name(self):
        page = (SOURCE / "data" / "python.md").read_text()
        for name in toothprep.__all__:
            self.assertIn(name, page)


if __name__ == "__main__":
    main()
