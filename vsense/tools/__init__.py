"""What is done before and beside runs: cameras set up, robots measured, documents."""
