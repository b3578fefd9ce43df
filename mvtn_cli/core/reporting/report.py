"""`report.html`: one file that shows what a run has learned, and opens anywhere without a network."""

from __future__ import annotations

from pathlib import Path

from mvtn_cli.core.reporting import sections
from mvtn_cli.core.reporting.confusion import confusion_layout
from mvtn_cli.core.reporting.gather import Findings, gather
from mvtn_cli.core.reporting.templating import template
from mvtn_cli.core.reporting.view_section import view_analysis_section
from mvtn_cli.core.reporting.viewer import viewer_section
from mvtn_cli.core.training.checkpoint import write_run_file


def write_report(run: Path, folder: Path | None = None, *, page: Path | None = None) -> Path:
    """Write `report.html` beside the evaluation of a run.

    Args:
        run: The run's folder.
        folder: Where its evaluation lies, and the report goes; the run's folder by default.
        page: Another file for it.

    Raises:
        DataError: The run hasn't been evaluated there.
    """
    path = page or Path(folder or run) / "report.html"
    write_run_file(path, render_report(gather(run, folder)).encode())
    return path


def render_report(findings: Findings) -> str:
    """Make the page. The same findings give the same text."""
    return template("report.html.jinja").render(
        name=findings.name,
        result=findings.result,
        run=findings.run,
        command=findings.command,
        summary=sections.summary(findings),
        figures=sections.headline(findings),
        curves=sections.learning_curves(findings),
        cameras=sections.camera_section(findings),
        analysis=view_analysis_section(findings),
        viewer=viewer_section(findings),
        shapes=sections.before_and_after(findings),
        repeated=[pair for pair in findings.result["top_confusions"] if pair["count"] > 1],
        confusion=confusion_layout(findings.result["confusion"], findings.result["classes"]),
        wrong=findings.result["count"] - findings.result["correct"],
        mistakes=sections.mistakes(findings),
        settings=sections.settings(findings.config),
    )
