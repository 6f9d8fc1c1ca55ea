"""`vsense benchmark`: three fixed missions that qualify a lab, rendered or real."""
