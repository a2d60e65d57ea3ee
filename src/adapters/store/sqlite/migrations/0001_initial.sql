-- Times are UTC nanoseconds since 1970-01-01. Documents are JSON as docs/wire-format.md describes it.
-- Types are SQLite's; PostgreSQL: INTEGER -> BIGINT, REAL -> DOUBLE PRECISION, BLOB -> BYTEA,
-- INTEGER PRIMARY KEY AUTOINCREMENT -> BIGINT GENERATED ALWAYS AS IDENTITY PRIMARY KEY.

CREATE TABLE sites (
    name        TEXT    NOT NULL PRIMARY KEY,
    s_base_mva  REAL    NOT NULL,
    v_base_kv   REAL    NOT NULL,
    nominal_hz  REAL    NOT NULL,
    updated_ns  INTEGER NOT NULL
) STRICT;

CREATE TABLE windows (
    id                 TEXT    NOT NULL PRIMARY KEY,
    site               TEXT    NOT NULL REFERENCES sites (name),
    onset_ns           INTEGER NOT NULL,
    onset_index        INTEGER NOT NULL,
    start_ns           INTEGER NOT NULL,
    sample_count       INTEGER NOT NULL,
    rate_fps           REAL    NOT NULL,
    lowest_voltage_pu  REAL,             -- null: no usable sample
    triggers           TEXT    NOT NULL, -- words, joined by blanks, in order of first appearance
    closing            TEXT    NOT NULL,
    stored_ns          INTEGER NOT NULL,
    announced_ns       INTEGER           -- null: its summary has not been put on its key yet
) STRICT;
CREATE INDEX windows_by_site ON windows (site, onset_ns);
CREATE INDEX windows_by_onset ON windows (onset_ns);
CREATE INDEX windows_unannounced ON windows (onset_ns) WHERE announced_ns IS NULL;

-- Apart from their windows: lists of windows need not pass over them, and retention drops them first.
CREATE TABLE waveforms (
    window_id  TEXT NOT NULL PRIMARY KEY REFERENCES windows (id) ON DELETE CASCADE,
    data       BLOB NOT NULL
) STRICT;

CREATE TABLE screenings (
    window_id    TEXT    NOT NULL PRIMARY KEY REFERENCES windows (id) ON DELETE CASCADE,
    usable       INTEGER NOT NULL CHECK (usable IN (0, 1)),
    document     TEXT    NOT NULL,
    screened_ns  INTEGER NOT NULL
) STRICT;

CREATE TABLE jobs (
    id              INTEGER NOT NULL PRIMARY KEY AUTOINCREMENT,
    kind            TEXT    NOT NULL,
    site            TEXT    NOT NULL REFERENCES sites (name),
    subject         TEXT    NOT NULL,
    inputs_hash     TEXT    NOT NULL,
    state           TEXT    NOT NULL
        CHECK (state IN ('queued', 'claimed', 'done', 'parked', 'superseded')),
    due_ns          INTEGER NOT NULL,
    claim           INTEGER NOT NULL DEFAULT 0, -- how often it was claimed: tells old holders from new
    worker          TEXT,
    lease_until_ns  INTEGER,
    failures        INTEGER NOT NULL DEFAULT 0,
    interruptions   INTEGER NOT NULL DEFAULT 0,
    last_error      TEXT,
    outcome         TEXT,
    enqueued_ns     INTEGER NOT NULL,
    ended_ns        INTEGER,
    UNIQUE (kind, subject, inputs_hash),
    CHECK ((state = 'claimed') = (lease_until_ns IS NOT NULL))
) STRICT;
CREATE INDEX jobs_by_state ON jobs (state, id);

CREATE TABLE fits (
    id              INTEGER NOT NULL PRIMARY KEY AUTOINCREMENT,
    kind            TEXT    NOT NULL,
    site            TEXT    NOT NULL REFERENCES sites (name),
    subject         TEXT    NOT NULL,
    inputs_hash     TEXT    NOT NULL,
    structure       TEXT    NOT NULL, -- JSON array of names
    content_hash    TEXT    NOT NULL,
    eps_p_percent   REAL,
    eps_q_percent   REAL,
    error_to_noise  REAL,
    solution_count  INTEGER NOT NULL,
    stored_ns       INTEGER NOT NULL,
    set_document    TEXT,             -- null: pruned
    document        TEXT,             -- null: pruned
    UNIQUE (kind, subject, inputs_hash)
) STRICT;
CREATE INDEX fits_by_site ON fits (site, kind, id);

CREATE TABLE fit_events (
    fit_id     INTEGER NOT NULL REFERENCES fits (id) ON DELETE CASCADE,
    window_id  TEXT    NOT NULL, -- no reference: the window may have been pruned
    role       TEXT    NOT NULL CHECK (role IN ('fitted', 'held_out')),
    PRIMARY KEY (fit_id, window_id)
) STRICT;
CREATE INDEX fit_events_by_window ON fit_events (window_id);

CREATE TABLE validations (
    fit_id    INTEGER NOT NULL PRIMARY KEY REFERENCES fits (id) ON DELETE CASCADE,
    status    TEXT    NOT NULL CHECK (status IN ('pass', 'fail', 'cannot_judge')),
    document  TEXT    NOT NULL
) STRICT;

CREATE TABLE decisions (
    id           INTEGER NOT NULL PRIMARY KEY AUTOINCREMENT,
    fit_id       INTEGER NOT NULL UNIQUE REFERENCES fits (id),
    site         TEXT    NOT NULL REFERENCES sites (name),
    document     TEXT    NOT NULL, -- what was decided, and why
    evidence     TEXT    NOT NULL,
    actor        TEXT    NOT NULL,
    decided_ns   INTEGER NOT NULL,
    awaiting     INTEGER NOT NULL CHECK (awaiting IN (0, 1)),
    approved     INTEGER CHECK (approved IN (0, 1)), -- null: nobody was asked, or nobody answered yet
    approver     TEXT,
    approval_ns  INTEGER,
    comment      TEXT,
    version      INTEGER           -- null: not published
) STRICT;
CREATE INDEX decisions_by_site ON decisions (site, id);
CREATE INDEX decisions_awaiting ON decisions (id) WHERE awaiting = 1;

-- Also the outbox: a version is here from the moment it is assigned, and published_ns says whether
-- it has been put on its key. Whoever dies in between publishes the same version again.
CREATE TABLE parameter_sets (
    site          TEXT    NOT NULL REFERENCES sites (name),
    version       INTEGER NOT NULL CHECK (version >= 1),
    content_hash  TEXT    NOT NULL,
    document      TEXT    NOT NULL,
    fit_id        INTEGER NOT NULL REFERENCES fits (id),
    committed_ns  INTEGER NOT NULL,
    published_ns  INTEGER,
    PRIMARY KEY (site, version),
    UNIQUE (site, content_hash)
) STRICT;
CREATE INDEX parameter_sets_unpublished ON parameter_sets (committed_ns) WHERE published_ns IS NULL;

-- Only ever added to.
CREATE TABLE audit (
    id      INTEGER NOT NULL PRIMARY KEY AUTOINCREMENT,
    at_ns   INTEGER NOT NULL,
    site    TEXT    NOT NULL,
    actor   TEXT    NOT NULL,
    action  TEXT    NOT NULL,
    detail  TEXT    NOT NULL
) STRICT;
CREATE INDEX audit_by_site ON audit (site, id);
CREATE TRIGGER audit_is_not_changed BEFORE UPDATE ON audit
BEGIN SELECT RAISE(ABORT, 'the audit trail is only added to'); END;
CREATE TRIGGER audit_is_not_deleted BEFORE DELETE ON audit
BEGIN SELECT RAISE(ABORT, 'the audit trail is only added to'); END;
