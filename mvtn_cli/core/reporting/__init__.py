"""What a person gets to look at: the report of a run, plots, contact sheets, tables."""

from mvtn_cli.core.reporting.images import contact_sheet
from mvtn_cli.core.reporting.report import write_report
from mvtn_cli.core.reporting.tables import compare_table
from mvtn_cli.core.reporting.view_sheets import render_views

__all__ = ["compare_table", "contact_sheet", "render_views", "write_report"]
