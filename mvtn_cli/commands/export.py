"""`mvtn export`: a run as files that other programs read."""

from __future__ import annotations

from mvtn_cli.commands.options import Call
from mvtn_cli.commands.sources import find_run
from mvtn_cli.console import duration
from mvtn_cli.export_config import ExportConfig


def export(config: ExportConfig, call: Call) -> None:
    """Write the networks of a run as ONNX, checked with onnxruntime, with labels, weights and a model card.

    Example: mvtn export --out my_model
    """
    from mvtn_cli.core.export import export_run

    run = find_run(config.run, config.runs, call)
    result = export_run(run, config, call.console)
    rows = [(one["file"], ", ".join(one["inputs"]), f"{one['difference']:.1e}") for one in result["networks"]]
    call.console.table(str(result["folder"]), ["network", "inputs", "largest difference"], rows, stream="out")
    call.console.result(result)
    if result["accuracy"] is None:
        call.console.warn(f"the model card names no accuracy: mvtn eval {run.path} measures it")
    call.console.note(f"exported {run.path} in {duration(call.seconds)}: {result['folder']}")
