"""Judge runs: their errors, whether their covariances are right, tables and pictures."""
