"""Holds the statistics of campaigns against SciPy and statsmodels, on data that the test made."""

import json
import math
import sys
import warnings
from types import SimpleNamespace

import numpy as np
from scipy import stats
from statsmodels.stats.contingency_tables import mcnemar
from statsmodels.stats.proportion import proportion_confint

TOLERANCE = 1e-9
data = json.load(open(sys.argv[1]))
compared = {}


def same(kind, own, other):
    compared[kind] = compared.get(kind, 0) + 1
    assert math.isclose(own, other, rel_tol=TOLERANCE, abs_tol=TOLERANCE), f"{kind}: {own}, {other}"


for rate in data["rates"]:
    low, high = proportion_confint(rate["count"], rate["of"], alpha=0.05, method="wilson")
    same("rate", rate["own"]["low"], low)
    same("rate", rate["own"]["high"], high)

for case in data["medians"]:
    sample, drawn = np.array(case["sample"]), np.array(case["drawn"])
    same("median", case["median"], np.median(sample))
    # With no samples of its own, SciPy makes its interval of those that it is handed.
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        interval = stats.bootstrap(
            (sample,),
            np.median,
            n_resamples=0,
            bootstrap_result=SimpleNamespace(bootstrap_distribution=drawn),
            method="BCa",
        ).confidence_interval
    if case["ends"] is None:
        assert math.isnan(interval.low), f"SciPy has {interval} of {sample}"
        compared["no interval"] = compared.get("no interval", 0) + 1
    else:
        same("interval", case["ends"][0], interval.low)
        same("interval", case["ends"][1], interval.high)

for case in data["times"]:
    if not case["came"]:
        assert case["steps"] == []
        continue
    found = stats.ecdf(stats.CensoredData(uncensored=case["came"], right=case["censored"])).cdf
    for step in case["steps"]:
        same("distribution", step["share"], float(found.evaluate(step["value"])))

for pair in data["pairs"]:
    table = [[10, pair["first"]], [pair["second"], 10]]
    same("pairs", pair["p"], mcnemar(table, exact=True).pvalue)

for quantile in data["quantiles"]:
    same("quantile", quantile["z"], stats.norm.ppf(quantile["share"]))

assert compared["interval"] >= 16 and compared["distribution"] >= 100, compared
print(compared)
