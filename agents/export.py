"""A trained agent's net as plain numbers: policy.npz and agent.toml, which vse_gym.policy.TrainedPolicy runs.

    python agents/export.py MODEL.zip --trust --algorithm ppo --action brakes --controller esc --out DIR

does it to what another program trained, rl_zoo3 say, through vse_gym.wrappers.CanonicalView. A zip of stable-baselines3
holds pickles, which run code when they are loaded: --trust says that you know where it comes from.
"""

import io
import json
import warnings
from collections.abc import Mapping
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated, Any

import numpy as np
import typer
from settings import ALGORITHMS
from torch import nn

from vse_gym.cli_screen import screen, sentences
from vse_gym.evaluation.files import write_whole
from vse_gym.policy import CARD, FORMAT, WEIGHTS, TrainedPolicy, digest


def actor_of(algorithm: str, model: Any) -> tuple[list[nn.Module], nn.LSTM | None, str]:
    """Layers of the net that acts, the LSTM in front of them, and how its answer gets into [-1, 1]."""
    policy = model.policy
    if algorithm == "sac":
        return [*policy.actor.latent_pi, policy.actor.mu], None, "tanh"
    if algorithm == "td3":
        *layers, _ = policy.actor.mu  # the last is the tanh
        return layers, None, "tanh"
    lstm = policy.lstm_actor if algorithm == "recurrent_ppo" else None
    return [*policy.mlp_extractor.policy_net, policy.action_net], lstm, "clip"


def arrays_of(algorithm: str, model: Any) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
    """Arrays by the names of :func:`vse_gym.controllers.network.shapes`, and what a card says of the net.

    Raises:
        ValueError: If the net has parts that an exported one has not.
    """
    layers, lstm, squash = actor_of(algorithm, model)
    full = [layer for layer in layers if isinstance(layer, nn.Linear)]
    between = {type(layer) for layer in layers} - {nn.Linear}
    if not between <= {nn.Tanh} and not between <= {nn.ReLU}:
        raise ValueError(
            f"only nets of full layers with tanh or relu alone are exported, not {sorted(map(str, between))}"
        )
    arrays: dict[str, Any] = {}
    if lstm is not None:
        if lstm.num_layers != 1:
            raise ValueError(f"only nets with one layer of LSTM are exported, not {lstm.num_layers}")
        arrays = {
            "lstm.weight_ih": lstm.weight_ih_l0,
            "lstm.weight_hh": lstm.weight_hh_l0,
            "lstm.bias": lstm.bias_ih_l0 + lstm.bias_hh_l0,
        }
    for k, layer in enumerate(full):
        arrays |= {f"layers.{k}.weight": layer.weight, f"layers.{k}.bias": layer.bias}
    told = {
        "activation": "relu" if nn.ReLU in between else "tanh",
        "squash": squash,
        "sizes": [layer.out_features for layer in full],
        "memory": lstm.hidden_size if lstm is not None else 0,
    }
    return {name: array.detach().cpu().numpy() for name, array in arrays.items()}, told


def write_agent(
    folder: Path,
    algorithm: str,
    model: Any,
    view: Mapping[str, str],
    trained: Mapping[str, Any],
    evaluation: Mapping[str, Any],
) -> None:
    """Write the two files of an agent.

    Args:
        folder: Where.
        algorithm: One of ALGORITHMS.
        model: Of that class.
        view: Observation, action and controller of the environment.
        trained, evaluation: Tables of the card.
    """
    arrays, told = arrays_of(algorithm, model)
    buffer = io.BytesIO()
    np.savez(buffer, allow_pickle=False, **arrays)
    folder.mkdir(parents=True, exist_ok=True)
    write_whole(folder / WEIGHTS, buffer.getvalue())
    card = {"format": FORMAT, "algorithm": algorithm, **view, **told, "weights": digest(buffer.getvalue())}
    write_whole(folder / CARD, toml({**card, "trained": trained, "evaluation": evaluation}).encode())


def toml(table: Mapping[str, Any], name: str = "") -> str:
    """A table of words, numbers, lists of them and tables as TOML; None is left out."""
    plain = {key: value for key, value in table.items() if not isinstance(value, Mapping) and value is not None}
    lines = [f"[{name}]"] if name and plain else []
    lines += [f"{key} = {json.dumps(value, ensure_ascii=False)}" for key, value in plain.items()]
    text = "\n".join(lines) + "\n" if lines else ""
    for key, value in table.items():
        if isinstance(value, Mapping):
            text += "\n" * bool(text) + toml(value, f"{name}.{key}" if name else key)
    return text


def main(
    model: Annotated[Path, typer.Argument(help="A zip that stable-baselines3 saved.")],
    out: Annotated[Path, typer.Option(help="Folder for policy.npz and agent.toml.")],
    algorithm: Annotated[str, typer.Option(help=f"One of {', '.join(ALGORITHMS)}.")] = "ppo",
    action: Annotated[str, typer.Option(help="As the environment was made with.")] = "brakes",
    controller: Annotated[str, typer.Option(help="The same.")] = "none",
    observation: Annotated[str, typer.Option(help="The same.")] = "estimate",
    trust: Annotated[bool, typer.Option("--trust", help="Loading the zip may run code; do it.")] = False,
) -> None:
    """Export what another program trained, through vse_gym.wrappers.CanonicalView, with stable-baselines3."""
    with sentences():
        if algorithm not in ALGORITHMS:
            raise ValueError(f"algorithm must be one of {', '.join(ALGORITHMS)}, not {algorithm!r}")
        if not trust:
            raise ValueError(f"{model} may run code when it is loaded: --trust does it all the same")
        with warnings.catch_warnings():  # of a buffer that is no matter here
            warnings.filterwarnings("ignore", "`n_steps=", UserWarning)
            loaded = ALGORITHMS[algorithm].load(model, device="cpu")
        view = {"observation": observation, "action": action, "controller": controller}
        with TemporaryDirectory() as trial:
            for folder in (Path(trial), out):  # a view that does not fit is refused before anything is left behind
                write_agent(folder, algorithm, loaded, view, {"from": model.name}, {})
                TrainedPolicy(str(folder))
    screen.print(f"written: {out}")


app = typer.Typer(add_completion=False)
app.command()(main)

if __name__ == "__main__":
    app()
