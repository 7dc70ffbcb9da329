"""What is measured: one module or package per campaign, with `options` and `main`."""
