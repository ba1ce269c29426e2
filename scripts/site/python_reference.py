"""The Python reference: the docstrings of the built module `toothprep`, with the signatures of its stubs (.pyi) where it
has some, as one Markdown page.

Run as a program it prints that page:  python_reference.py FOLDER_OF_THE_MODULE
"""
import ast
import inspect
import re
import subprocess
import sys
from pathlib import Path


def python_reference(folder):
    """(the page, faults) of the module in `folder`; None if there is none. Another process imports it."""
    if not any(any(Path(folder).glob(built)) for built in ("toothprep.py", "toothprep*.so", "toothprep/_core*.so")):
        return None
    done = subprocess.run(["/usr/bin/python3", "-B", __file__, str(folder)], capture_output=True, text=True, check=False)
    if done.returncode not in (0, 1) or not done.stdout:
        return "", [f"importing toothprep from {folder} failed: {done.stderr.strip()}"]
    return done.stdout, done.stderr.splitlines()


def defaults(what):
    """{parameter: its default as text}, of a function in Python or of a compiled one's docstring."""
    try:
        known = inspect.signature(what).parameters.values()
        return {p.name: repr(p.default) for p in known if p.default is not p.empty}
    except (TypeError, ValueError):
        first = (inspect.getdoc(what) or "").partition("\n")[0]
        return dict(re.findall(r"(\w+)(?:: [^=,()]+)? = (\([^()]*\)|\[[^]]*\]|'[^']*'|[^,()]+)", first))


def with_defaults(call, what):
    """A stub's function with what it leaves open (`...`) filled in."""
    known = defaults(what)
    plain = call.args.posonlyargs + call.args.args
    pairs = list(zip(plain[len(plain) - len(call.args.defaults):], call.args.defaults))
    call.args.defaults = [ast.Name(known.get(a.arg, "...")) for a, _ in pairs]
    call.args.kw_defaults = [d and ast.Name(known.get(a.arg, "...")) for a, d in
                             zip(call.args.kwonlyargs, call.args.kw_defaults)]
    return call


def stubs(module):
    """({name or Class.name: [its calls]}, the names of types that they use) of the module's stub file."""
    path = Path(module.__file__).with_suffix(".pyi")
    calls, types = {}, []
    body = ast.parse(path.read_text(encoding="utf-8")).body if path.is_file() else []
    for node in body:
        if isinstance(node, ast.Assign) and node.targets[0].id.startswith("_"):
            types.append(ast.unparse(node))
        for prefix, call in [("", node)] + [(node.name + ".", n) for n in getattr(node, "body", [])
                                            if isinstance(node, ast.ClassDef)]:
            if isinstance(call, ast.FunctionDef):
                owner = getattr(module, prefix[:-1], None) if prefix else module
                call = with_defaults(call, getattr(owner, call.name, None))
                call.args.args = [a for a in call.args.args if a.arg != "self"]
                returns = f" -> {ast.unparse(call.returns)}" if call.returns else ""
                calls.setdefault(prefix + call.name, []).append(f"{call.name}({ast.unparse(call.args)}){returns}")
    return calls, types


def signature_and_text(name, what):
    """The call as a reader writes it, and what stands below it. Of a compiled function both are in the docstring."""
    text = inspect.getdoc(what) or ""
    first, _, rest = text.partition("\n")
    if re.match(r"\w+\(.*\)( -> .*)?$", first):
        if first.startswith(f"{name}(*args, **kwargs)"):  # overloads, numbered
            calls = re.findall(r"^\d+\. (\w+\(.*)$", rest, re.M)
            rest = re.sub(r"^\d+\. \w+\(.*$", "", rest.replace("Overloaded function.", ""), flags=re.M)
            return calls, inspect.cleandoc(rest)
        return [first], inspect.cleandoc(rest)
    try:
        return [f"{name}{inspect.signature(what)}"], text
    except (TypeError, ValueError):
        return [f"{name}(...)"], text


def readable(text):
    """A docstring as Markdown: paragraphs in columns stay as they stand."""
    parts = text.split("\n\n")
    return "\n\n".join(f"```text\n{part}\n```" if len(re.findall(r"^\S+ {2,}\S", part, re.M)) > 1 else part
                       for part in parts)


def shown(calls):
    """Without what a reader does not write: the module's own name, `self` and its type."""
    calls = [re.sub(r"\(self(: [\w.]+)?(, )?", "(", re.sub(r"\btoothprep\.(_\w+\.)?", "", call)) for call in calls]
    return "```python\n" + "\n".join(calls) + "\n```"


def reference(module):
    """(Markdown, the names that have no docstring)."""
    lines, bare = ["# Python reference", "", inspect.getdoc(module) or ""], []
    stub, types = stubs(module)
    if types:
        lines += ["", "Types in signatures:", "", shown(types)]
    names = getattr(module, "__all__", None) or [n for n in dir(module) if not n.startswith("_")]
    members = {n: getattr(module, n) for n in names}
    classes = {n: m for n, m in members.items() if inspect.isclass(m)}
    for name, what in sorted(members.items()):
        if callable(what) and name not in classes:
            calls, text = signature_and_text(name, what)
            calls = stub.get(name, calls)
            lines += ["", f"## {name}", "", shown(calls), "", readable(text)]
            bare += [] if text else [name]
    for name, what in sorted(classes.items()):
        text = inspect.getdoc(what) or ""
        lines += ["", f"## class {name}", "", readable(text)]
        bare += [] if text else [name]
        for key, member in vars(what).items():
            if key.startswith("_") and key != "__init__":
                continue
            if isinstance(member, property) or inspect.isdatadescriptor(member):
                text = inspect.getdoc(member) or ""
                lines += ["", f"`{key}`: {text}"]
            elif callable(member):
                calls, text = signature_and_text(key, member)
                calls = stub.get(f"{name}.{key}", calls)
                calls = [c.replace("__init__(", f"{name}(", 1).removesuffix(" -> None") for c in calls]
                if calls == [f"{name}(self, /, *args, **kwargs)"]:  # made by other calls only
                    continue
                lines += ["", shown(calls), "", readable(text)]
            else:
                continue
            bare += [] if text or key == "__init__" else [f"{name}.{key}"]
    return "\n".join(lines) + "\n", bare


def main():
    sys.path.insert(0, sys.argv[1])
    import toothprep
    text, bare = reference(toothprep)
    print(text)
    for name in bare:
        print(f"{name} has no docstring", file=sys.stderr)
    sys.exit(1 if bare else 0)


if __name__ == "__main__":
    main()
