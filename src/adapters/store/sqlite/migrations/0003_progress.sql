-- How far each site's measurements have come: written once a second while any arrive.
CREATE TABLE progress (
    site       TEXT    NOT NULL PRIMARY KEY REFERENCES sites (name),
    newest_ns  INTEGER NOT NULL,
    rate_fps   REAL    NOT NULL
) STRICT;
