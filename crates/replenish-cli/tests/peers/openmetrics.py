"""Reads the text of `replenish metrics` with the parser of Prometheus's client library, which refuses
what OpenMetrics does not allow. Prints the number of samples.
"""

import sys

from prometheus_client.openmetrics.parser import text_string_to_metric_families

with open(sys.argv[1], encoding="utf-8") as file:
    families = list(text_string_to_metric_families(file.read()))
assert all(family.type != "unknown" and family.documentation for family in families)
print(sum(len(family.samples) for family in families))
