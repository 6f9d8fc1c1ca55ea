"""Many runs and what they show: series, campaigns, the benchmark, packages, reports."""
