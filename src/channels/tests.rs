//! Rules of many names, as renderers write them.
