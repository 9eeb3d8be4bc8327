"""A study's file with a mistake in it: the sentence names the file, the place and what may be written."""

import re

import pytest

from vse_gym.evaluation import Cell, Study

HEAD = "version = 1\n"
CELL = '[[cell]]\nname = "a"\nmanoeuvre = "held_steer"\n'
KNOWN_CELL = "known: name, manoeuvre, vehicle, controller, sensors, plant, benign, settings, randomise"
KNOWN_STUDY = "known: version, seeds, first_seed, estimators, randomise, attribution, matched, cell"

WRONG = {
    "an empty file": ("", "it lacks version, a whole number"),
    "no cell": (HEAD, "at least one [[cell]]"),
    "broken TOML": ("version = \n", "line 1"),
    "a word that no file has": (HEAD + "seed = 3\n" + CELL, f"a study has no seed; {KNOWN_STUDY}"),
    "cells by another name": (HEAD + CELL.replace("cell", "cel"), f"a study has no cel; {KNOWN_STUDY}"),
    "a cell that is no list": (HEAD + CELL.replace("[[cell]]", "[cell]"), "cell must be tables, each under a line"),
    "a fraction of seeds": (HEAD + "seeds = 2.5\n" + CELL, "seeds must be a whole number, not 2.5"),
    "one word for a list": (
        HEAD + 'estimators = "ekf"\n' + CELL,
        'estimators must be a list of words, as ["ekf", "ukf"], not \'ekf\'',
    ),
    "one number for a range": (
        HEAD + "[randomise]\nmass = 1.25\n" + CELL,
        "randomise: mass must be two numbers, as [1.0, 1.25], not 1.25",
    ),
    "three for a range": (HEAD + "[randomise]\nmass = [1, 2, 3]\n" + CELL, "randomise: mass must be two numbers"),
    "a reversed range": (
        HEAD + "[randomise]\nmass = [1.25, 1.0]\n" + CELL,
        "randomise: mass must be two positive numbers, the lower first, not [1.25, 1.0]",
    ),
    "a negative range": (HEAD + "[randomise]\nspeed_kmh = -4\n" + CELL, "randomise: speed is drawn to both sides"),
    "a range without a unit": (
        HEAD + "[randomise]\nmass_deg = [1.0, 1.2]\n" + CELL,
        "randomise: cannot randomise mass_deg; known: speed, ",
    ),
    "a misspelt key": (HEAD + CELL.replace("manoeuvre", "manouvre"), f"cell 'a': a cell has no manouvre; {KNOWN_CELL}"),
    "no manoeuvre": (HEAD + '[[cell]]\nname = "a"\n', "cell 'a': it lacks manoeuvre, a word in quotes"),
    "no name": (HEAD + '[[cell]]\nmanoeuvre = "held_steer"\n', "cell 1: it lacks name, a word in quotes"),
    "yes for true": (HEAD + CELL + 'benign = "yes"\n', "cell 'a': benign must be true or false, not 'yes'"),
    "an unknown name": (HEAD + CELL + 'controller = "abs"\n', "cell 'a': no controller named 'abs'; known: none"),
    "an unknown plant": (HEAD + CELL + 'plant = "lorry"\n', "cell 'a': no plant named 'lorry'; known: double_track"),
    "a word for a speed": (
        HEAD + CELL + 'settings = { speed_kmh = "x" }\n',
        "cell 'a': speed_kmh must be a number, not 'x'",
    ),
    "a misspelt setting": (
        HEAD + CELL + "settings = { amplitud_deg = 3 }\n",
        "cell 'a': manoeuvre 'held_steer' has no setting amplitud_deg; known: speed, friction",
    ),
    "a speed given twice": (
        HEAD + CELL + "settings = { speed_kmh = 80, speed = 20 }\n",
        "cell 'a': speed is given twice: speed_kmh, speed",
    ),
    "an impossible setting": (
        HEAD + CELL + "settings = { speed_kmh = -80 }\n",
        "cell 'a': speed must be positive",
    ),
    "a cell's own range": (HEAD + CELL + "randomise = { tilt = 1 }\n", "cell 'a': cannot randomise tilt; known: speed"),
}


@pytest.mark.parametrize(("text", "sentence"), WRONG.values(), ids=WRONG)
def test_a_mistake_is_a_sentence_that_names_the_file_the_place_and_the_choices(tmp_path, text, sentence):
    path = tmp_path / "mine.toml"
    path.write_text(text)
    with pytest.raises((KeyError, TypeError, ValueError), match=re.escape(sentence)) as refused:
        Study.load(path)
    said = str(refused.value)
    assert said.startswith(f"{path}: ")
    assert "__init__" not in said and "iterable" not in said


def test_whole_numbers_stand_for_numbers_and_the_rest_is_the_default(tmp_path):
    path = tmp_path / "mine.toml"
    path.write_text(HEAD + "[randomise]\nmass = [1, 2]\nslope_deg = 1\n" + CELL + "settings = { speed_kmh = 72 }\n")
    study = Study.load(path)
    assert study.randomise.mass == (1, 2) and study.randomise.stiffness == (1, 1)
    assert study.cells == (Cell("a", "held_steer", settings={"speed_kmh": 72}),)
    assert study.cells[0].scenario(study.randomise, 0).nominal.speed == pytest.approx(20.0)
