"""The pages as a strict reader sees them: well-formed, complete, loading nothing.

Usage: test_page.py SAMPLE_SCORE_PAGE
"""
import base64
import re
import subprocess
import sys
import tempfile
import xml.etree.ElementTree as ElementTree
from html.parser import HTMLParser
from pathlib import Path

VOID = {"meta", "br", "img", "link", "input", "hr"}
CHECKS = 0


def check(condition, message):
    global CHECKS
    CHECKS += 1
    if not condition:
        sys.exit(f"FAILED: {message}")


class Balance(HTMLParser):
    """HTML's own rules: every element closed in its turn, no attribute that would load something."""

    def __init__(self):
        super().__init__()
        self.open, self.tags, self.classes = [], set(), set()

    def handle_starttag(self, tag, attributes):
        self.tags.add(tag)
        for name, value in attributes:
            check(not name.startswith("on"), f"attribute {name} on {tag}")
            if name in ("src", "href", "xlink:href", "srcset", "data", "action"):
                check(value.startswith("data:"), f"{tag} loads {value[:60]}")
            if name == "class":
                self.classes.update(value.split())
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag, attributes):
        self.handle_starttag(tag, attributes)
        if tag not in VOID:
            self.open.pop()

    def handle_endtag(self, tag):
        check(self.open and self.open[-1] == tag, f"</{tag}> closes {self.open[-1:]}")
        self.open.pop()


def look_at(page):
    text = page.decode("utf-8")
    root = ElementTree.fromstring(text)  # well-formed, so attributes are quoted and text is escaped
    parser = Balance()
    parser.feed(text)
    parser.close()
    check(not parser.open, f"left open: {parser.open}")
    check(not parser.tags & {"script", "link", "iframe", "object", "embed", "audio", "video", "base"},
          f"has {parser.tags}")
    style = root.find(".//style").text
    check("@import" not in style and "url(" not in style, "the style sheet loads something")
    check(not re.search(r"https?://", text), "an address of the web")
    check("nan" not in re.sub(r"[a-z]nan|nan[a-z]", "", re.sub(r"base64,[^\"]*", "", text)), "a NaN")
    # Every class has a style.
    styled = set(re.findall(r"\.([a-zA-Z][\w-]*)", style))
    check(parser.classes <= styled, f"no style for {parser.classes - styled}")
    # Drawings keep within finite numbers, clip paths have names of their own.
    identifiers = [e.get("id") for e in root.iter() if e.get("id")]
    check(len(identifiers) == len(set(identifiers)), "an id twice")
    for svg in root.iter("svg"):
        x, y, width, height = map(float, svg.get("viewBox").split())
        check(0 < width < 2000 and 0 < height < 2000, f"a drawing of {width} x {height}")
        for path in svg.iter("path"):
            check(re.fullmatch(r"([ML]-?[\d.]+ -?[\d.]+|Z)+", path.get("d")), f"path {path.get('d')[:60]}")
    return root, text


def main():
    program = sys.argv[1]
    with tempfile.TemporaryDirectory() as first, tempfile.TemporaryDirectory() as second:
        for folder in (first, second):
            subprocess.run([program, folder], check=True)
        pages = {}
        for name in ("class2", "crown"):
            page = (Path(first) / f"{name}.html").read_bytes()
            check(page == (Path(second) / f"{name}.html").read_bytes(), f"{name}: two runs differ")
            pages[name] = look_at(page)

    root, text = pages["class2"]
    check("<script>" not in text, "a file name became markup")
    words = " ".join(root.itertext())
    check("<script>alert(1)</script> & \"Müller\".vdb" in words, "the file name is not shown as it is")
    check("FAILED" in words and "The pulp is open" in words.replace("the pulp", "The pulp"), "no verdict")
    images = [e.get("src") for e in root.iter("img")]
    check(len(images) == 2, "pictures are missing")
    for image in images:
        check(base64.b64decode(image.split(",", 1)[1], validate=True).startswith(b"\x89PNG"), "not a PNG")
    for label in ("3.1°", "-13.4°", "2.13 mm", "6.72 mm"):
        check(label in words, f"the section's {label} is missing")
    for part in ("Criteria", "Pictures", "Sections", "Deviation from the target", "Course of the work",
                 "All figures"):
        check(part in [h.text for h in root.iter("h2")], f"no part '{part}'")

    root, _ = pages["crown"]
    parts = [h.text for h in root.iter("h2")]
    check(parts == ["Criteria", "Sections", "All figures"], f"parts {parts}")
    check("PASSED" in " ".join(root.itertext()), "no pass")
    print(f"{CHECKS} checks passed")


if __name__ == "__main__":
    main()
