-- Also an outbox: published_ns says whether a diagnosis has been put on its key.
CREATE TABLE diagnoses (
    site            TEXT    NOT NULL REFERENCES sites (name),
    version         INTEGER NOT NULL CHECK (version >= 1),
    inputs_hash     TEXT    NOT NULL,
    structure       TEXT    NOT NULL, -- JSON array of names
    status          TEXT    NOT NULL,
    summary         TEXT    NOT NULL,
    answer_set      TEXT    NOT NULL, -- JSON array of names
    error_to_noise  REAL,
    stored_ns       INTEGER NOT NULL,
    published_ns    INTEGER,
    document        TEXT,             -- null: pruned
    PRIMARY KEY (site, version),
    UNIQUE (site, inputs_hash)
) STRICT;
CREATE INDEX diagnoses_unpublished ON diagnoses (stored_ns) WHERE published_ns IS NULL;

-- Which model a site is to have; the newest row counts. Only ever added to.
CREATE TABLE structures (
    id          INTEGER NOT NULL PRIMARY KEY AUTOINCREMENT,
    site        TEXT    NOT NULL REFERENCES sites (name),
    structure   TEXT    NOT NULL, -- JSON array of names
    origin      TEXT    NOT NULL,
    actor       TEXT    NOT NULL,
    comment     TEXT    NOT NULL,
    changed_ns  INTEGER NOT NULL
) STRICT;
CREATE INDEX structures_by_site ON structures (site, id);

-- Which version counts: the one whose turn came last. A version that is rolled back to gets a new one.
ALTER TABLE parameter_sets ADD COLUMN turn INTEGER NOT NULL DEFAULT 0;
UPDATE parameter_sets SET turn = version;
CREATE INDEX parameter_sets_by_turn ON parameter_sets (site, turn);
