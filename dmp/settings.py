"""Every hyper-parameter of the method in one frozen dataclass, with its unit, its default and its source.

The command line and the run panel of the application are generated from this declaration. "The paper" is Hattori et al.
2021; "the authors' published code" is astaka-pe/DeepMeshPrior, in its newest state of June 2024 (95c5529) unless its first one
of April 2021 (92b56c8) is named.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import Field, asdict, dataclass, field, fields, replace
from typing import Any, Literal, get_args, get_type_hints

from dmp.errors import SettingsError

Task = Literal["denoise", "complete"]
Preset = Literal["compact", "paper", "paper-2021-04", "best"]
Method = Literal["prior", "recorrupted", "made-up-holes"]
Convolution = Literal["gcn", "chebyshev", "gmm", "gmm-geometric"]
Architecture = Literal["2024-06", "2021-04"]
LaplacianForm = Literal["mean", "sum"]
Scaling = Literal["edge", "box"]
Smoothing = Literal["laplacian", "spherical", "none"]
Prediction = Literal["displacement", "position"]
LaplacianOf = Literal["prediction", "change"]
KnownVertices = Literal["keep", "predict"]
Precision = Literal["auto", "float32", "bfloat16"]


def _setting(
    default: Any, help: str, *, minimum: float | None = None, maximum: float | None = None, advanced: bool = True
) -> Any:
    return field(default=default, metadata={"help": help, "minimum": minimum, "maximum": maximum, "advanced": advanced})


@dataclass(frozen=True)
class Settings:
    """What a training does. Field metadata holds ``help``, ``minimum``, ``maximum`` and ``advanced`` (hidden at first).

    Build one with :func:`settings_for`, which applies a preset and checks the values.
    """

    task: Task = _setting("denoise", "What to do: remove noise, or fill holes.", advanced=False)
    preset: Preset = _setting(
        "compact",
        "'compact' is fast and improved, 'paper' follows the authors' published code, 'paper-2021-04' its first version of "
        "April 2021 (denoising only), 'best' needs no choice of a step.",
        advanced=False,
    )
    method: Method = _setting(
        "prior",
        "'prior' is Deep Mesh Prior; 'recorrupted' trains on copies with more noise and needs no early stopping; "
        "'made-up-holes' is for completion and learns from holes where the truth is known.",
    )
    steps: int = _setting(1000, "Training steps (optimiser updates).", minimum=1, maximum=10_000_000, advanced=False)
    snapshot_every: int = _setting(25, "Keep the predicted mesh every so many steps.", minimum=1, advanced=False)
    log_every: int = _setting(5, "Write losses and metrics every so many steps.", minimum=1)
    seed: int = _setting(
        42, "Seed of everything random: network, input, held-out vertices.", minimum=0, maximum=2**63 - 1, advanced=False
    )
    device: str = _setting("auto", "Where to compute: auto, cpu, cuda or cuda:N.", advanced=False)
    threads: int = _setting(0, "Processor threads for the training; 0 chooses by itself.", minimum=0, maximum=1024)
    precision: Precision = _setting(
        "auto",
        "Numbers between the layers: 'float32'; 'bfloat16', which is shorter and faster on some processors; 'auto' takes the "
        "shorter ones where they are faster. On a GPU 'bfloat16' is not there; 'auto' rounds what is multiplied to 10 binary "
        "places (TF32), 'float32' does not.",
    )
    memory: float = _setting(
        0.0,
        "Memory that the training may use, in GB (10^9 bytes); 0 for what is free. Too little is refused at once.",
        minimum=0.0,
        maximum=1e6,
    )

    convolution: Convolution = _setting(
        "gcn",
        "Graph convolution of the network: 'gcn' and 'chebyshev' see which vertices are joined, 'gmm' weighs neighbours by how "
        "many neighbours they have, 'gmm-geometric' by length, slope and direction of the edge to them. As in the authors' "
        "published code 'gmm' does not see the shape, although the paper says that it does.",
    )
    chebyshev_order: int = _setting(
        2,
        "Convolution 'chebyshev': number of polynomials; each after the first looks one ring of neighbours farther (authors' "
        "published code: 2).",
        minimum=1,
        maximum=10,
    )
    gmm_kernels: int = _setting(
        5,
        "Convolutions 'gmm' and 'gmm-geometric': number of Gaussian kernels (authors' published code: 5).",
        minimum=1,
        maximum=64,
    )
    architecture: Architecture = _setting(
        "2024-06",
        "Layers of the network, by the month of the authors' published code: 13 convolutions in 2024-06, 10 in 2021-04.",
    )
    skip: bool = _setting(
        False, "Join the second half of the layers to the outputs of the first half, as a variant of the authors' code does."
    )
    width_divisor: int = _setting(
        4, "Divides the published numbers of channels, never below 16; 1 is the published network.", minimum=1, maximum=32
    )
    input_channels: int = _setting(
        16, "Fixed random numbers that each vertex has as input (authors' published code: 16).", minimum=1, maximum=1024
    )
    learning_rate: float = _setting(0.01, "Step size of the optimiser, Adam (paper: 0.01).", minimum=1e-8, maximum=10.0)
    laplacian_weight: float = _setting(
        1.4,
        "Weight of the Laplacian term, which keeps neighbours together; 0 switches it off (authors' published code: 1.4).",
        minimum=0.0,
        maximum=1e6,
    )
    laplacian_form: LaplacianForm = _setting(
        "mean",
        "Laplacian term: 'mean' is the distance of a vertex from the mean of its neighbours (authors' published code), 'sum' "
        "the same times their number (paper, and the code of April 2021).",
    )
    laplacian_epsilon: float = _setting(
        1e-12,
        "Added to the squared distance before its root in the Laplacian term, in squared training units.",
        minimum=1e-24,
        maximum=1.0,
    )
    laplacian_of: LaplacianOf = _setting(
        "prediction",
        "What the Laplacian term keeps smooth: the prediction (paper), or what it changes of the input or its filling.",
    )
    predict: Prediction = _setting(
        "displacement", "What the network predicts: displacements from the smoothed mesh, or positions."
    )
    smoothing: Smoothing = _setting(
        "laplacian",
        "What displacements start from: the input after 'laplacian' smoothing, the input spread over a sphere ('spherical', "
        "for closed meshes without handles), or the input itself ('none').",
    )
    smoothing_steps: int = _setting(
        30, "Steps of Laplacian smoothing (authors' published meshes: 30).", minimum=0, maximum=100_000
    )
    scaling: Scaling = _setting(
        "edge", "Length that is 1 during training: the mean edge, or the largest side of the bounding box."
    )
    hold_out: float = _setting(
        0.03, "Share of the vertices hidden from the data term; their error shows overfitting.", minimum=0.0, maximum=0.5
    )
    average: float = _setting(
        0.99,
        "Decay of the running average that is shown as the prediction: of the outputs, or with 'recorrupted' of the weights; "
        "0 shows each output itself.",
        minimum=0.0,
        maximum=0.9999,
    )

    # What follows is of completion alone.
    known_vertices: KnownVertices = _setting(
        "keep", "Completion: leave the vertices of the input exactly where they are, or take the prediction for them too."
    )
    max_hole_edges: int = _setting(0, "Completion: leave holes with more edges than this open; 0 fills them all.", minimum=0)
    rest_movement: float = _setting(
        0.0,
        "Completion: end when the inserted vertices move less than this, in mean edge lengths per 100 steps; 0 never.",
        minimum=0.0,
        maximum=1e3,
    )

    # What follows is of the method 'recorrupted' alone; its sources are measurements on generated meshes.
    noise_level: float = _setting(
        0.0, "Noise along the normal, in mean edge lengths (standard deviation); 0 estimates it.", minimum=0.0, maximum=10.0
    )
    noise_tangential: float = _setting(
        -1.0, "Noise across the normal as a share of that along it, 0 to 1; -1 estimates it.", minimum=-1.0, maximum=1.0
    )
    recorruption: float = _setting(
        1.0, "Noise added to the input of each step, as a share of the noise that is there.", minimum=0.05, maximum=20.0
    )
    normal_weight: float = _setting(10.0, "Weight of the term on face normals.", minimum=0.0, maximum=1e6)
    bilateral_layers: int = _setting(
        6, "Layers of learned bilateral filtering, before one of many passes that flattens what is flat.", minimum=0, maximum=32
    )
    normal_passes: int = _setting(4, "Averagings of the normals in each bilateral layer.", minimum=0, maximum=100)
    vertex_passes: int = _setting(2, "Vertex updates in each bilateral layer.", minimum=0, maximum=100)
    patch_size: int = _setting(
        4000, "Vertices that one training step looks at; larger meshes are trained in patches.", minimum=100, maximum=10_000_000
    )


SETTING_FIELDS: Mapping[str, Field[Any]] = {item.name: item for item in fields(Settings)}
_TYPES = get_type_hints(Settings)

# What differs from the defaults above. 'paper' and 'paper-2021-04' keep the published behaviour in everything: unit box, full
# width, nothing held out, no averaging, weights and steps of the two states of the published code.
_PRESETS: dict[tuple[str, str], dict[str, Any]] = {
    ("compact", "denoise"): {"learning_rate": 0.02},
    ("compact", "complete"): {
        "steps": 8000, "snapshot_every": 100, "log_every": 10, "laplacian_weight": 1.0, "laplacian_of": "change",
        "hold_out": 0.0, "rest_movement": 0.02,
    },
    ("paper", "denoise"): {
        "steps": 5000, "snapshot_every": 50, "width_divisor": 1, "scaling": "box", "hold_out": 0.0, "average": 0.0,
    },
    ("paper", "complete"): {
        "steps": 8000, "snapshot_every": 100, "log_every": 10, "width_divisor": 1, "scaling": "box", "hold_out": 0.0,
        "average": 0.0, "laplacian_weight": 0.2,
    },
    ("paper-2021-04", "denoise"): {
        "steps": 4000, "snapshot_every": 50, "architecture": "2021-04", "width_divisor": 1, "scaling": "box", "hold_out": 0.0,
        "average": 0.0, "laplacian_weight": 0.2, "laplacian_form": "sum", "laplacian_epsilon": 1e-6,
    },
    ("best", "complete"): {
        "method": "made-up-holes", "steps": 800, "snapshot_every": 50, "log_every": 10, "learning_rate": 0.004, "hold_out": 0.0,
        "average": 0.0,
    },
    ("best", "denoise"): {
        "method": "recorrupted", "steps": 200, "snapshot_every": 10, "log_every": 10, "learning_rate": 0.004, "hold_out": 0.1,
        "average": 0.97,
    },
}  # fmt: skip


# What a completion that also denoises changes: the prediction everywhere, under the settings of denoising.
DENOISE_TOO: Mapping[str, Any] = {
    "preset": "compact", "known_vertices": "predict", "laplacian_weight": 1.4, "laplacian_of": "prediction",
    "learning_rate": 0.02, "hold_out": 0.03, "rest_movement": 0.0,
    "steps": 1000, "snapshot_every": 25, "log_every": 5,
}  # fmt: skip


def choices(name: str) -> tuple[str, ...]:
    """Return the allowed texts of the setting ``name``, or an empty tuple where any value of its type is allowed."""
    hint = _TYPES[name]
    return get_args(hint) if hint not in (bool, int, float, str) else ()


def default_preset(task: str) -> str:
    """Return the preset that is taken for a task when none is named.

    Denoising opens with Deep Mesh Prior, where a person watches and chooses; completion with what was measured to come
    closest to the true surface.
    """
    return "best" if task == "complete" else "compact"


def presets_for(task: str) -> tuple[str, ...]:
    """Return the presets that a task has."""
    return tuple(preset for preset in choices("preset") if (preset, task) in _PRESETS)


def preset_value(name: str, task: str, preset: str) -> Any:
    """Return the value of a setting in one of the presets of a task."""
    return _PRESETS[(preset, task)].get(name, SETTING_FIELDS[name].default)


def settings_for(task: str = "denoise", preset: str | None = None, **overrides: Any) -> Settings:
    """Return the settings of a preset for a task, with single values replaced.

    Without a preset it is :func:`default_preset` of the task.

    Values of ``None`` among the overrides mean "as the preset says", so that a command line can pass everything on.

    Raises:
        SettingsError: for an unknown name or a value outside its range.
    """
    preset = preset or default_preset(task)
    if (preset, task) not in _PRESETS:
        check("task", task)
        check("preset", preset)
        others = ", ".join(presets_for(task))
        raise SettingsError(
            f"--preset {preset} is for denoising alone: the authors' code of that time could not fill holes. "
            f"Use one of: {others}."
        )
    values = {**_PRESETS[(preset, task)], **{name: value for name, value in overrides.items() if value is not None}}
    for name in values:
        if name not in SETTING_FIELDS:
            raise SettingsError(f"There is no setting '{name}'. The settings are: {', '.join(SETTING_FIELDS)}.")
    return validated(replace(Settings(), task=task, preset=preset, **values))  # type: ignore[arg-type]


def check(name: str, value: Any) -> Any:
    """Return ``value`` as the type of the setting ``name``.

    Raises:
        SettingsError: when the value has another type or lies outside the allowed range.
    """
    shown = name.replace("_", "-")
    allowed = choices(name)
    if allowed:
        if value not in allowed:
            raise SettingsError(f"--{shown} is '{value}', but must be one of: {', '.join(allowed)}.")
        return value
    kind = _TYPES[name]
    if kind is str:
        if not isinstance(value, str):
            raise SettingsError(f"--{shown} must be a text, not {value!r}.")
        return value
    if kind is bool:
        if not isinstance(value, bool):
            raise SettingsError(f"--{shown} must be true or false, not {value!r}.")
        return value
    if isinstance(value, bool) or not isinstance(value, (int, float)) or (kind is int and value != int(value)):
        raise SettingsError(f"--{shown} must be {'a whole number' if kind is int else 'a number'}, not {value!r}.")
    if not math.isfinite(value):
        raise SettingsError(f"--{shown} must be a finite number, not {value!r}.")
    meta = SETTING_FIELDS[name].metadata
    low, high = meta["minimum"], meta["maximum"]
    if (low is not None and value < low) or (high is not None and value > high):
        bounds = f"at least {low:g}" if high is None else f"between {low:g} and {high:g}"
        raise SettingsError(f"--{shown} is {value:g}, but must be {bounds}.")
    return kind(value)


def setting_value(text: str) -> Any:
    """Return a value from its text: true or false, a number, or the text itself."""
    if text.lower() in ("true", "false"):
        return text.lower() == "true"
    for kind in (int, float):
        try:
            return kind(text)
        except ValueError:
            continue
    return text


def validated(settings: Settings) -> Settings:
    """Return the settings with each value checked and converted to its type (raises :class:`SettingsError`)."""
    values = {name: check(name, value) for name, value in asdict(settings).items()}
    device = values["device"]
    known = device in ("auto", "cpu", "cuda") or (device.startswith("cuda:") and device[5:].isdecimal())
    if not known:
        raise SettingsError(f"--device is '{device}', but must be auto, cpu, cuda or cuda:N.")
    return Settings(**values)


def from_mapping(values: Mapping[str, Any]) -> Settings:
    """Rebuild settings that :func:`dataclasses.asdict` wrote, ignoring names that this version does not know."""
    return validated(Settings(**{name: value for name, value in values.items() if name in SETTING_FIELDS}))
