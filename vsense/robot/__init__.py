"""What a lab does with its robots' boards: builds `vsensed` for them and brings it there."""
