//! Hash-consed expression graphs: exact derivatives, scheduling, evaluation.
