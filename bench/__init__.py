"""The benchmarks: worlds that drives come from, and campaigns that judge the program on them."""
