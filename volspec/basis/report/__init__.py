"""How good a basis is: errors of pairs and products, tables by light class, their text."""

from volspec.basis.report.errors import BasisReport, ErrorSummary, ProductErrors, WorstPair, report
from volspec.basis.report.table import ErrorTable, error_table

__all__ = [
    "BasisReport",
    "ErrorSummary",
    "ErrorTable",
    "ProductErrors",
    "WorstPair",
    "error_table",
    "report",
]
