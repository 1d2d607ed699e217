"""Records and run folders: what every command leaves."""

from flowlik.results.records import Record, protocol, read_records, select
from flowlik.results.runs import RunFolder

__all__ = ["Record", "RunFolder", "protocol", "read_records", "select"]
