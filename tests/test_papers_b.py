"""The comparison of two particle filters whose particles carry their covariances."""

import sys
from importlib import import_module
from pathlib import Path

from vse_gym.evaluation.tunings import ranges

sys.path.insert(0, str(Path(__file__).parents[1] / "benchmarks"))
papers_b = import_module("papers_b")
papers_common = import_module("papers_common")


def test_what_is_carried_is_searched_but_for_the_published_filters():
    for name in ("upf", "acpf"):
        searched, published = (ranges(getattr(papers_b, n)) for n in (name, f"{name}_carrying"))
        assert searched.keys() - published.keys() == {"carried"}
        assert searched.items() >= published.items()


def test_everybody_that_is_compared_hears_the_drives():
    paper = papers_common.Paper("B", range(6))
    everybody = papers_b.contenders(paper, papers_b.ALL)
    for which, (upf, acpf) in (papers_b.PAIRS | papers_b.MORE).items():
        assert isinstance(everybody[upf], papers_b.UnscentedParticleFilter)
        assert isinstance(everybody[acpf], papers_b.AdaptiveCubatureParticleFilter)
        assert everybody[upf].size == everybody[acpf].size == int(upf.split()[1].rstrip(",")), which


def test_the_published_filters_carry_all_of_a_particles_covariance():
    everybody = papers_b.contenders(papers_common.Paper("B", range(6)), papers_b.ALL)
    for which, names in papers_b.PAIRS.items():
        if "published" in which:
            assert {everybody[name].carried for name in names} == {1.0}
