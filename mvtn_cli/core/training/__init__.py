"""The one training loop, runs on disk, going on, comparing and predicting."""
