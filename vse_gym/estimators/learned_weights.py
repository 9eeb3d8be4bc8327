"""Files of trained weights: an .npz without pickle, and a .toml beside it that says where they come from."""

import zipfile
import zlib
from collections.abc import Mapping
from functools import lru_cache
from hashlib import blake2b
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vse_gym.inference.recurrent import RecurrentNet
from vse_gym.registry import UnknownNameError

FOLDER = Path(__file__).parent / "trained"
WORDS = ("estimator", "features", "outputs")  # what a file says beside the weights


class Trained(NamedTuple):
    """A net, and the file's digest."""

    net: RecurrentNet
    digest: str


def shipped_weights() -> list[str]:
    """The names of those that come with the package."""
    return sorted(path.stem for path in FOLDER.glob("*.npz"))


def weights_path(weights: str) -> Path:
    """Where shipped weights, or those of a file of one's own, lie.

    Raises:
        UnknownNameError: If there is no such file; the message says which are shipped.
    """
    path = Path(weights) if str(weights).endswith(".npz") else FOLDER / f"{weights}.npz"
    if not path.is_file():
        known = ", ".join(shipped_weights()) or "none"
        raise UnknownNameError(f"no weights named {str(weights)!r}; shipped: {known}, or the path of an .npz file")
    return path


def save_weights(path: Path, estimator: str, net: RecurrentNet, features: Mapping[str, Any], outputs: Any) -> str:
    """Write a net, at once or not at all; returns the file's digest."""
    words = {"estimator": np.array(estimator), "features": np.array(list(features)), "outputs": np.array(list(outputs))}
    numbers = {name: np.asarray(values, dtype=np.float32) for name, values in net._asdict().items()}
    draft = path.with_name(path.name + ".part")
    with draft.open("wb") as file:
        np.savez_compressed(file, allow_pickle=False, **numbers, **words)
    draft.replace(path)
    return _digest(path)


def load_weights(weights: str, estimator: str, features: Mapping[str, Any], outputs: Mapping[str, Any]) -> Trained:
    """The net of an estimator, checked.

    Args:
        weights: A shipped name, or the path of an .npz file.
        estimator: Whose they must be.
        features: Names of what it hears, in order.
        outputs: Names of what it says, in order.

    Raises:
        UnknownNameError: If there is no such file.
        ValueError: If the file is corrupt, or of something else; the message says what is wrong with it.
    """
    path = weights_path(weights)
    return _load(path, path.stat().st_mtime_ns, estimator, tuple(features), tuple(outputs))


@lru_cache(maxsize=16)
def _load(path: Path, changed: int, estimator: str, features: tuple[str, ...], outputs: tuple[str, ...]) -> Trained:
    arrays = _read(path)
    if missing := sorted({*RecurrentNet._fields, *WORDS} - arrays.keys()):
        raise ValueError(f"{path}: no weights of a learned estimator: it lacks {', '.join(missing)}")
    if (owner := str(arrays["estimator"])) != estimator:
        raise ValueError(f"{path}: weights of {owner!r}, expected those of {estimator!r}")
    for word, expected in (("features", features), ("outputs", outputs)):
        if tuple(arrays[word].ravel().tolist()) != expected:
            raise ValueError(f"{path}: trained with other {word} than this version has; train it again")
    kinds = {name: arrays[name].dtype.kind for name in RecurrentNet._fields}
    if wrong := sorted(name for name, kind in kinds.items() if kind != "f"):
        raise ValueError(f"{path}: {', '.join(wrong)} must be floating point numbers")
    net = RecurrentNet(*(np.ascontiguousarray(arrays[name], dtype=float) for name in RecurrentNet._fields))
    size, inputs, out = net.hidden_bias.size // 3, len(features), len(outputs)
    shapes = (inputs, 3 * size), (size, 3 * size), (3 * size,), (3 * size,), (size, out), (out,)
    for name, array, shape in zip(net._fields, net, shapes, strict=True):
        if array.shape != shape or not size:
            raise ValueError(f"{path}: {name} has the shape {array.shape}, expected {shape}")
        if not np.isfinite(array).all():
            raise ValueError(f"{path}: {name} holds numbers that are not finite")
        array.flags.writeable = False
    return Trained(net, _digest(path))


def _read(path: Path) -> dict[str, NDArray[Any]]:
    try:
        with path.open("rb") as stream:
            file = np.load(stream, allow_pickle=False)
            if not isinstance(file, np.lib.npyio.NpzFile):
                raise ValueError("a single array")
            return {name: file[name] for name in file.files}
    except (OSError, ValueError, EOFError, KeyError, zipfile.BadZipFile, zlib.error) as error:
        raise ValueError(f"{path}: not a sound .npz file of plain arrays ({error})") from None


def _digest(path: Path) -> str:
    return blake2b(path.read_bytes(), digest_size=8).hexdigest()
