"""Many meshes, many settings, and other machines: lists of jobs that dask.distributed spreads over worker processes.

A job is one mesh with its settings (:mod:`dmp.batch.jobs`). :func:`dmp.batch.doing.do_job` does one in any process, into a
folder (:mod:`dmp.batch.folder`); :mod:`dmp.batch.engine` has many of them done by the workers of a dask cluster
(:mod:`dmp.batch.cluster`), and :mod:`dmp.batch.summary` tells what came of it. Which worker does what, and what happens when
one dies, is dask's business.
"""
