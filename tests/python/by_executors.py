"""Runs ``campaign.toml`` in the current folder by executors whose workers are killed during the study.

``by_executors.py dask``: Dask on two workers, one of which is killed in the middle. ``by_executors.py pool``: a pool of
processes that is killed in the middle, and another pool that completes the study.
"""

import os
import signal
import sys
import threading
import time
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import phalanx


def complete(out):
    return sum("." not in run.name for run in Path(out, "runs").glob("*"))


def killed_once_begun(pids, out):
    """Kills processes once three runs are complete. Returns the thread, and a list to which it appends the number of complete runs."""
    seen = []

    def kill():
        while complete(out) < 3:
            time.sleep(0.002)
        for pid in pids():
            os.kill(pid, signal.SIGKILL)
        seen.append(complete(out))

    thread = threading.Thread(target=kill)
    thread.start()
    return thread, seen


def by_dask():
    from distributed import Client, LocalCluster

    with LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as cluster, Client(cluster) as client:
        first = next(iter(client.run(os.getpid).values()))
        thread, seen = killed_once_begun(lambda: [first], "dask")
        campaign = phalanx.sweep("campaign.toml", executor=client.get_executor(), out="dask")
        thread.join()
        alive = client.run(os.getpid).values()
    print("killed in the middle", 3 <= seen[0] < 12, "gone", first not in alive)
    # A rate and a median, as in the report.
    point, row = campaign.document["points"][0], campaign.statistics.iloc[0]
    held, error = point["held"], point["final_error_m_max"]
    print(*(int(row[key]) for key in ("number", "runs", "missing")), campaign.runs.shape[0], len(campaign.timing), len(campaign.pairs))
    print(list(row[["held_count", "held_of", "held", "held_low", "held_high"]])
          == [held["count"], held["of"], *(held["rate"][key] for key in ("value", "low", "high"))])
    print(list(row[["final_error_m_max_of", "final_error_m_max", "final_error_m_max_low"]])
          == [error["of"], error["median"]["value"], error["median"]["low"]])
    print(campaign.run(campaign.runs.run[0]).summary["trajectory_hash"] == campaign.runs.trajectory_hash[0])


def by_pool():
    pool = ProcessPoolExecutor(2)
    with pool:
        thread, seen = killed_once_begun(lambda: list(pool._processes), "pool")
        try:
            phalanx.sweep("campaign.toml", executor=pool, out="pool", chunk=2)
        except phalanx.RunError as error:
            print(error.code, error)
        thread.join()
    there = complete("pool")
    print("killed in the middle", 3 <= seen[0] < 12, "there", there)
    with ProcessPoolExecutor(2) as pool:
        campaign = phalanx.sweep("campaign.toml", executor=pool, out="pool", in_process=True)
    print(len(campaign.runs))


if __name__ == "__main__":
    {"dask": by_dask, "pool": by_pool}[sys.argv[1]]()
