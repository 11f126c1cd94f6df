"""The report: tables and figures as files, one self-contained page, and `report.json`."""

from analysis.report.build import Report, build_report, report_of

__all__ = ["Report", "build_report", "report_of"]
