"""The report of a sweep: one page that explains itself, its numbers, its pictures."""

from benchmarks.report.writing import load, no_report, require_report, rewrite_report, write_report

__all__ = ["load", "no_report", "require_report", "rewrite_report", "write_report"]
