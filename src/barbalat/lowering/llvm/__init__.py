"""The LLVM target: the operation list as machine code with SIMD lanes."""
