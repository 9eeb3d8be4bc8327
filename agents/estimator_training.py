"""Training of a recurrent net on sequences: likelihood, truncated back-propagation through time, checkpoints.

Nothing here knows a car: a sequence has features and targets, and some of both change their sign in a mirror.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vse_gym.inference.recurrent import RecurrentNet

Floats = NDArray[np.float32]
DOUBT = 5.0  # as vse_gym.estimators.learned has it
CAP = 20.0  # of a number's loss when epochs are compared, so that one lost drive does not decide
BUCKET = 8  # batches among which sequences are sorted by length, so that little is padded


class Recording(NamedTuple):
    """Of one drive, T instants."""

    features: Floats  # (T, F)
    targets: Floats  # (T, M), in units about one


class Parity(NamedTuple):
    """-1 for what changes its sign in a mirror, else 1."""

    inputs: NDArray[Any]  # (F,)
    outputs: NDArray[Any]  # (2 M,): means, then logarithms of standard deviations


@dataclass(frozen=True)
class Training:
    """How a net is trained."""

    seed: int = 0
    epochs: int = 30
    hidden: int = 64
    batch: int = 64  # drives
    window: int = 100  # instants through which errors are propagated back
    rate: float = 3e-3  # of learning, at first; it falls as half a cosine to a fiftieth
    clip: float = 1.0  # largest norm of a gradient
    beta: float = 0.5  # weight of the likelihood by the variance to this power: Seitzer et al. (2022)
    threads: int = 1  # more cost more than they bring: the net is small


def new_net(inputs: int, hidden: int, outputs: int) -> Any:
    """A gated recurrent layer, and a dense one that begins near zero: first of all, the plain motion is right."""
    import torch

    net = torch.nn.ModuleDict(
        {"cell": torch.nn.GRU(inputs, hidden, batch_first=True), "output": torch.nn.Linear(hidden, outputs)}
    )
    with torch.no_grad():
        net["output"].weight.mul_(0.1)
        net["output"].bias.zero_()
    return net


def exported(net: Any) -> RecurrentNet:
    """The weights as compiled code reads them."""
    cell, output = net["cell"], net["output"]
    arrays = (cell.weight_ih_l0.T, cell.weight_hh_l0.T, cell.bias_ih_l0, cell.bias_hh_l0, output.weight.T, output.bias)
    return RecurrentNet(*(np.ascontiguousarray(a.detach().numpy(), dtype=float) for a in arrays))


def say(net: Any, x: Any, hidden: Any, parity: Any) -> tuple[Any, Any]:
    """The mean of what the net says of x (B, T, F) and of its mirror image: outputs (B, T, 2 M) and hidden states."""
    import torch

    inner, hidden = net["cell"](torch.cat([x, x * parity.inputs]), hidden)
    one, other = net["output"](inner).chunk(2)
    return 0.5 * (one + parity.outputs * other), hidden


def likelihood(outputs: Any, targets: Any, beta: float = 0.0) -> Any:
    """Negative logarithm of a heteroscedastic Gaussian likelihood, of each number: Nix, Weigend (1994).

    With ``beta`` each is weighted by its variance to that power, as if constant: an instant that is hard to foretell
    then still pulls at the mean, which plain likelihood lets go. The optimum stays where it is. Seitzer et al. (2022).
    """
    mean, log_std = outputs.chunk(2, dim=-1)
    log_std = log_std.clamp(-DOUBT, DOUBT)
    loss = 0.5 * ((targets - mean) * (-log_std).exp()) ** 2 + log_std + 0.5 * math.log(2 * math.pi)
    return loss * (2 * beta * log_std.detach()).exp() if beta else loss


def padded(sequences: Sequence[Recording]) -> tuple[Any, Any, Any]:
    """Features (B, T, F), targets (B, T, M) and which are real (B, T, 1)."""
    import torch

    longest = max(len(s.features) for s in sequences)
    x = torch.zeros(len(sequences), longest, sequences[0].features.shape[1])
    y, real = (
        torch.zeros(len(sequences), longest, sequences[0].targets.shape[1]),
        torch.zeros(len(sequences), longest, 1),
    )
    for k, s in enumerate(sequences):
        x[k, : len(s.features)], y[k, : len(s.targets)] = torch.from_numpy(s.features), torch.from_numpy(s.targets)
        real[k, : len(s.features)] = 1
    return x, y, real


def batches(sequences: Sequence[Recording], size: int, seed: int, epoch: int) -> Iterator[list[Recording]]:
    """All sequences once, in an order that seed and epoch alone decide."""
    rng = np.random.default_rng((seed, epoch))
    order = rng.permutation(len(sequences))
    groups = []
    for start in range(0, len(order), BUCKET * size):
        near = sorted(order[start : start + BUCKET * size].tolist(), key=lambda k: len(sequences[k].features))
        groups += [near[k : k + size] for k in range(0, len(near), size)]
    for k in rng.permutation(len(groups)):
        yield [sequences[i] for i in groups[k]]


def outputs_of(net: Any, sequences: Sequence[Recording], parity: Parity, size: int = 128) -> list[Floats]:
    """What a net says of each sequence, (T, 2 M)."""
    import torch

    tensors, found = _tensors(parity), []
    with torch.no_grad():
        for start in range(0, len(sequences), size):
            some = sequences[start : start + size]
            said, _ = say(net, padded(some)[0], None, tensors)
            found += [said[k, : len(s.features)].numpy() for k, s in enumerate(some)]
    return found


def validation_loss(net: Any, sequences: Sequence[Recording], parity: Parity) -> float:
    """Mean negative logarithm of the likelihood over all instants, none of them above CAP."""
    import torch

    total = count = 0.0
    for said, s in zip(outputs_of(net, sequences, parity), sequences, strict=True):
        loss = likelihood(torch.from_numpy(said), torch.from_numpy(s.targets))
        total, count = total + float(loss.clamp(max=CAP).sum()), count + loss.numel()
    return total / count


def train(
    data: Sequence[Recording],
    validation: Sequence[Recording],
    parity: Parity,
    settings: Training,
    checkpoint: Path,
    tell: Callable[[int, float, float, Any], None] | None = None,
) -> tuple[Any, list[list[float]], int]:
    """Train a net, or go on from a checkpoint, which is written after each epoch: the end is the same.

    Args:
        data, validation: Sequences to learn from and to choose the best epoch by.
        parity: What changes its sign in a mirror.
        settings: How.
        checkpoint: A file.
        tell: Called after each epoch with its number, the losses of training and validation, and the net.

    Returns:
        The net of the best epoch, the two losses of each epoch, and which epoch was the best.

    Raises:
        ValueError: If the checkpoint is of a training with other settings.
    """
    import torch

    torch.set_num_threads(settings.threads)
    torch.manual_seed(settings.seed)
    net = new_net(len(parity.inputs), settings.hidden, len(parity.outputs))
    optimiser = torch.optim.Adam(net.parameters(), lr=settings.rate)
    history: list[list[float]] = []
    best, chosen = {k: v.clone() for k, v in net.state_dict().items()}, -1
    if checkpoint.exists():
        kept = torch.load(checkpoint, weights_only=True)
        if kept["settings"] != asdict(settings):
            raise ValueError(f"{checkpoint} is of a training with other settings, {kept['settings']}: move it away")
        net.load_state_dict(kept["net"])
        optimiser.load_state_dict(kept["optimiser"])
        history, best, chosen = kept["history"], kept["best"], kept["chosen"]
    for epoch in range(len(history), settings.epochs):
        for group in optimiser.param_groups:
            group["lr"] = settings.rate * (0.51 + 0.49 * math.cos(math.pi * epoch / settings.epochs))
        loss = _epoch(net, optimiser, batches(data, settings.batch, settings.seed, epoch), parity, settings)
        held = validation_loss(net, validation, parity)
        if not history or held < min(h[1] for h in history):
            best, chosen = {k: v.clone() for k, v in net.state_dict().items()}, epoch
        history.append([loss, held])
        state = {"net": net.state_dict(), "optimiser": optimiser.state_dict(), "settings": asdict(settings)}
        draft = checkpoint.with_name(checkpoint.name + ".part")
        torch.save(state | {"history": history, "best": best, "chosen": chosen}, draft)
        draft.replace(checkpoint)
        if tell is not None:
            tell(epoch, loss, held, net)
    net.load_state_dict(best)
    return net, history, chosen


def _tensors(parity: Parity) -> Parity:
    import torch

    return Parity(*(torch.tensor(np.asarray(p, dtype=np.float32)) for p in parity))


def _epoch(net: Any, optimiser: Any, groups: Iterator[list[Recording]], parity: Parity, settings: Training) -> float:
    import torch

    tensors, total, count = _tensors(parity), 0.0, 0.0
    for group in groups:
        x, y, real = padded(group)
        hidden = None
        for at in range(0, x.shape[1], settings.window):
            part = slice(at, at + settings.window)
            said, hidden = say(net, x[:, part], hidden, tensors)
            hidden = hidden.detach()  # truncated here: errors do not travel back beyond a window
            here, weight = real[:, part], real[:, part].sum() * y.shape[2]
            loss = (likelihood(said, y[:, part], settings.beta) * here).sum() / weight
            optimiser.zero_grad()
            loss.backward()
            torch.nn.utils.clip_grad_norm_(net.parameters(), settings.clip)
            optimiser.step()
            total, count = total + float(loss.detach()) * float(weight), count + float(weight)
    return total / count
