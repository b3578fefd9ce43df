"""Where settings come from, and what is said about wrong ones."""

from __future__ import annotations

import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any, get_args

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mvtn_cli.commands.settings import choices_of, in_order, resolve, to_toml
from mvtn_cli.config import MODELS, EvalConfig, PreprocessConfig, RenderViewsConfig, TrainConfig, TrainOptions
from mvtn_cli.errors import UsageError


def train(options: dict[str, Any] | None = None, file: Path | None = None) -> tuple[TrainOptions, dict[str, str]]:
    return resolve(TrainOptions, options or {}, file, "train")


def refused(options: dict[str, Any], file: Path | None = None) -> UsageError:
    with pytest.raises(UsageError) as caught:
        train(options, file)
    assert caught.value.exit_code == 2
    return caught.value


def test_option_beats_environment_beats_table_beats_top_level_beats_default(monkeypatch: pytest.MonkeyPatch):
    Path("mvtn.toml").write_text("epochs = 1\nlr = 0.1\nseed = 1\nclip = 1\n[train]\nepochs = 2\nlr = 0.2\nseed = 2\n")
    monkeypatch.setenv("MVTN_EPOCHS", "3")
    monkeypatch.setenv("MVTN_LR", "0.3")
    config, origins = train({"epochs": "4"})
    assert (config.epochs, config.lr, config.seed, config.clip, config.batch_size) == (4, 0.3, 2, 1, 32)
    assert [origins[name] for name in ("epochs", "lr", "seed", "clip", "batch_size")] == [
        *("--epochs", "MVTN_LR", "mvtn.toml [train]", "mvtn.toml", "default")
    ]


def test_a_named_file_takes_the_place_of_the_one_in_the_folder():
    Path("mvtn.toml").write_text("epochs = 1\n")
    Path("own.toml").write_text("lr = 0.5\n")
    config, origins = train(file=Path("own.toml"))
    assert (config.epochs, config.lr) == (30, 0.5)
    assert origins["lr"] == "own.toml"


def test_a_table_holds_for_its_command_alone_and_the_top_level_for_all():
    Path("mvtn.toml").write_text("runs = 'all'\n[train]\nseed = 5\n")
    evaluation, _ = resolve(EvalConfig, {}, None, "eval")
    assert (evaluation.runs, evaluation.seed) == (Path("all"), 0)
    assert train()[0].seed == 5


def test_keys_may_be_written_as_options():
    Path("mvtn.toml").write_text("[train]\nnum-views = 3\n")
    assert train()[0].num_views == 3


def test_an_empty_variable_says_nothing(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv("MVTN_EPOCHS", "")
    assert train()[1]["epochs"] == "default"


def test_auto_undoes_what_a_file_says():
    Path("mvtn.toml").write_text("[train]\nexplore = 0\nthreads = 1\n")
    config, origins = train({"explore": "auto"})
    assert config.explore is None and config.threads == 1
    assert origins["explore"] == "--explore"


def test_auto_can_be_wished_for_where_it_is_not_the_default():
    Path("mvtn.toml").write_text("batch_size = 8\n")
    options, _ = train({"batch_size": "auto"})
    assert options.batch_size is None and options.training().batch_size == 32  # until it is worked out
    Path("mvtn.toml").write_text("batch_size = 'auto'\n")
    for command in ("train", "sweep", "eval", "predict", "retrieve", "robustness"):
        assert resolve(MODELS[command], {}, None, command)[0].batch_size is None
    assert EvalConfig(batch_size=None).shapes_a_step(20) == 20 and EvalConfig(batch_size=3).shapes_a_step(20) == 3


@pytest.mark.parametrize("command", MODELS)
def test_the_written_configuration_reads_back_the_same(command: str):
    config = MODELS[command]()
    text = to_toml(config, dict.fromkeys(type(config).model_fields, "default"))
    assert type(config).model_validate(tomllib.loads(text)) == config
    assert all(line.endswith("  # default") for line in text.splitlines())


@given(
    st.integers(1, 100),
    st.floats(1e-9, 10),
    st.sampled_from(["fixed", "jittered", "random", "learned"]),
    st.text(st.characters(blacklist_categories=["Cs"]), min_size=1),
)
def test_any_configuration_reads_back_the_same(num_views: int, lr: float, views: str, dataset: str):
    config = TrainConfig(num_views=num_views, lr=lr, views=views, dataset=dataset)  # type: ignore[arg-type]
    assert TrainConfig.model_validate(tomllib.loads(to_toml(config))) == config


def test_every_setting_is_described_and_every_number_limited():
    for model in MODELS.values():
        assert set(in_order(model)) == set(model.model_fields)
        for name, field in model.model_fields.items():
            assert field.description, name
            assert field.annotation not in (int, float) or field.metadata, f"{model.__name__}.{name} has no limits"


def test_one_name_means_one_type_everywhere():
    """`--seed` is the same kind of thing in every command, so that a file's top level can hold it."""
    kinds: dict[str, set[str]] = {}
    for model in (*MODELS.values(), TrainConfig):
        for name, field in model.model_fields.items():
            parts = get_args(field.annotation)
            kind = parts[0] if type(None) in parts else field.annotation
            kinds.setdefault(name, set()).add(str(kind))
    several = {name for name, found in kinds.items() if len(found) > 1}
    assert several == {"azimuth", "elevation", "run"}  # lists for render-views and robustness, which take one, too
    assert RenderViewsConfig(azimuth=30, elevation="0,10").azimuth == (30.0,)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"epochs": "0"}, "--epochs must be at least 1, got 0"),
        ({"num_views": "101"}, "--num-views must be at most 100, got 101"),
        ({"lr": "0"}, "--lr must be more than 0, got 0"),
        ({"val_fraction": "1"}, "--val-fraction must be less than 1, got 1"),
        ({"epochs": "many"}, "--epochs must be a whole number, got 'many'"),
        ({"epochs": "1.5"}, "--epochs must be a whole number, got 1.5"),
        ({"epochs": "auto"}, "--epochs must be a whole number, got 'auto'"),
        ({"batch_size": "many"}, "--batch-size must be a whole number or auto, got 'many'"),
        ({"lr": "nan"}, "--lr must be a number, got nan"),
        ({"lr": ""}, "--lr must be a number, got ''"),
        ({"device": "gpu"}, "--device must be auto, cpu, cuda, cuda:N or mps, got 'gpu'"),
        ({"views": "lerned"}, "unknown views 'lerned'; did you mean 'learned'?"),
        ({"layout": "sferical"}, "unknown layout 'sferical'; did you mean 'spherical'?"),
        ({"supersample": "3"}, "unknown supersample '3'"),
        ({"compare": "fixed,jitter"}, "unknown views 'jitter'; did you mean 'jittered'?"),
        ({"compare": "fixed"}, "--compare needs two or more different selections, got 'fixed'"),
        ({"compare": "learned,learned-spherical"}, None),
        ({"views": "learned", "layout": "icosahedral"}, "there are no learned icosahedral views"),
        (
            {"views": "fixed", "layout": "icosahedral", "num_views": "6"},
            "the icosahedral layout has 12 views, not 6",
        ),
        ({"gradient": "none"}, "with --gradient none the pictures can't teach learned-spherical views"),
        ({"angles": "tanh"}, "--angles tanh belongs to --views learned-direct, not to learned-spherical"),
    ],
)
def test_a_wrong_value_is_refused_in_one_sentence(options: dict[str, str], message: str | None):
    error = refused(options)
    assert message is None or error.message == message
    assert "\n" not in error.message and error.code != "error"


def test_a_wrong_value_names_the_variable_or_the_file(monkeypatch: pytest.MonkeyPatch):
    Path("mvtn.toml").write_text("[train]\nepochs = 'x'\n")
    assert refused({}).message == "epochs in mvtn.toml [train] must be a whole number, got 'x'"
    monkeypatch.setenv("MVTN_EPOCHS", "-1")
    assert refused({}).message == "MVTN_EPOCHS must be at least 1, got -1"
    monkeypatch.setenv("MVTN_EPOCHS", "1")
    monkeypatch.setenv("MVTN_VIEWS", "lerned")
    assert refused({}).message == "unknown views 'lerned' (MVTN_VIEWS); did you mean 'learned'?"


@pytest.mark.parametrize(
    ("content", "message", "hint"),
    [
        ("[train]\nepoch = 3\n", "unknown key 'epoch' in mvtn.toml [train]", "did you mean 'epochs'?"),
        ("[trian]\nepochs = 3\n", "unknown key 'trian' in mvtn.toml", "did you mean 'train'?"),
        ("[eval]\nepochs = 3\n", "unknown key 'epochs' in mvtn.toml [eval]", None),
        ("qqq = 3\n", "unknown key 'qqq' in mvtn.toml", "keys are option names: num_views for --num-views"),
        ("epochs = \n", None, "a line looks like: epochs = 30"),
    ],
)
def test_a_wrong_file_is_refused(content: str, message: str | None, hint: str | None):
    Path("mvtn.toml").write_text(content)
    error = refused({})
    assert message is None or error.message == message
    assert hint is None or error.hint == hint


def test_a_missing_or_garbled_file_is_refused():
    assert "nowhere.toml can't be read: No such file" in refused({}, Path("nowhere.toml")).message
    Path("binary.toml").write_bytes(b"\xff\xfe")
    assert "binary.toml is not valid TOML" in refused({}, Path("binary.toml")).message


def test_learned_means_the_learned_form_of_the_layout():
    assert train({"views": "learned"})[0].views == "learned-spherical"
    assert train({"views": "learned", "layout": "circular"})[0].views == "learned-circular"


def test_a_solid_layout_brings_its_number_of_views():
    assert train({"views": "fixed", "layout": "dodecahedral"})[0].num_views == 20


def test_a_comparison_shares_its_settings_and_tanh_finds_the_selection_that_it_is_about():
    options, _ = train({"compare": "fixed, learned,learned-direct", "angles": "tanh", "layout": "circular"})
    assert options.selections() == ["fixed", "learned-circular", "learned-direct"]
    assert options.training().views == "learned-direct"
    assert type(options.training()) is TrainConfig


def test_choices_come_from_the_types():
    assert choices_of(PreprocessConfig, "on_bad") == ["fail", "skip"]
    assert choices_of(TrainOptions, "views")[-2:] == ["learned-spherical", "learned"]
    assert choices_of(TrainOptions, "epochs") == []


def test_show_config_prints_toml_with_the_origin_of_each_value(mvtn: Callable[..., Any]):
    Path("mvtn.toml").write_text("[train]\nlr = 0.5\n")
    result = mvtn("train", "builtin:shapes", "--epochs", "7", "--freeze-backbone", "--show-config")
    lines = result.out.splitlines()
    assert result.code == 0
    for line in (
        'dataset = "builtin:shapes"  # argument',
        "epochs = 7  # --epochs",
        "lr = 0.5  # mvtn.toml [train]",
        "freeze_backbone = true  # --freeze-backbone",
        "batch_size = 32  # default",
    ):
        assert line in lines
    Path("copy.toml").write_text(result.out)
    again = mvtn("train", "--config", "copy.toml", "--show-config", "--json").document
    assert again["config"]["epochs"] == 7 and again["origins"]["epochs"] == "copy.toml"


def test_a_switch_in_a_file_can_be_taken_back():
    Path("mvtn.toml").write_text("freeze_backbone = true\n")
    assert train()[0].freeze_backbone is True
