"""Runs the command lines of a file on a local cluster of HyperQueue."""

import sys

from hyperqueue import Job, LocalCluster
from hyperqueue.cluster import WorkerConfig

with LocalCluster() as cluster:
    cluster.start_worker(WorkerConfig(cores=2))
    client = cluster.client()
    job = Job()
    for line in open(sys.argv[1]):
        job.program(["bash", "-c", line])
    client.wait_for_jobs([client.submit(job)])
