"""What README shows is run as it stands there."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
README = (ROOT / "README.md").read_text(encoding="utf-8")
BLOCKS = re.findall(r"```python\n(.*?)```", README, re.DOTALL)


@pytest.mark.parametrize("number", range(len(BLOCKS)))
def test_an_example_runs_as_it_stands(number, tmp_path):
    script = tmp_path / "example.py"
    script.write_text(BLOCKS[number])
    done = subprocess.run([sys.executable, "-W", "error", script], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip()


def test_readme_has_the_examples_it_promises():
    assert len(BLOCKS) == 3


def test_every_file_that_readme_and_contributing_link_to_exists():
    for name in ("README.md", "CONTRIBUTING.md"):
        text = (ROOT / name).read_text(encoding="utf-8")
        for target in re.findall(r"\]\(([^)#:]+)\)", text):
            assert (ROOT / target).exists(), f"{name}: {target}"


def test_the_tree_in_readme_names_files_that_exist():
    tree = README.split("vse_gym/\n", 1)[1].split("```")[0]
    for name in re.findall(r"\b[\w]+\.py\b|\b\w+/", tree):
        places = [ROOT / name, ROOT / "vse_gym" / name, ROOT / "benchmarks" / name]
        assert any(place.exists() for place in places), name
