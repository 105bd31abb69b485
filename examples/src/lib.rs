//! Examples in the order a newcomer needs them.
