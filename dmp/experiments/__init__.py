"""The experiments of the paper, and some of our own, repeated on any mesh: jobs, how they are run, tables and pictures.

An experiment is a module with ``jobs(plan)``, the list of what has to be computed, and ``report(plan, results)``, which makes
tables, plots and pictures of what is there. Jobs know nothing of experiments and experiments nothing of processes: between
them stand the job (:mod:`dmp.experiments.jobs`), the function that does one (:mod:`dmp.experiments.doing`), the folder that
keeps results (:mod:`dmp.experiments.store`), and whoever has a list of jobs done (:mod:`dmp.experiments.running`).
"""
