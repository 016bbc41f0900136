//! Software reference renderer: the oracle that Farsight's images are judged by.
