//! A temporary `SQLite` database: it lives in its cache until that is full, then in a file without a name.
//!
//! Nothing is ever committed, for there is nothing to be kept safe. So there is no journal, and a database that could not be
//! written once cannot be used any more.

use std::io;

use rusqlite::Connection;

use crate::error::{Error, Result};

/// All that is not in the cache is in the one file. Everything happens in a transaction that has no end.
const SET_UP: &str = "
    PRAGMA journal_mode = OFF;
    PRAGMA synchronous = OFF;
    PRAGMA temp_store = MEMORY;
    BEGIN;
";

/// The database.
#[derive(Debug)]
pub(crate) struct Database(Connection);

impl Database {
    /// An empty database with these tables, of pages of so many bytes, so many of which are kept in memory.
    pub fn new(page_bytes: usize, cached_pages: usize, tables: &str) -> Result<Self> {
        let database = Self(open().map_err(|e| Error::spool("written", e))?);
        let pages = format!("PRAGMA page_size = {page_bytes}; PRAGMA cache_size = {cached_pages};");
        database.write(|connection| connection.execute_batch(&[&pages, SET_UP, tables].concat()))?;
        Ok(database)
    }

    /// Does something that writes; its failure is told as one of the spool.
    pub fn write<T>(&self, write: impl FnOnce(&Connection) -> rusqlite::Result<T>) -> Result<T> {
        write(&self.0).map_err(|e| Error::spool("written", io::Error::other(e)))
    }

    /// The same for reading.
    pub fn read<T>(&self, read: impl FnOnce(&Connection) -> rusqlite::Result<T>) -> Result<T> {
        read(&self.0).map_err(|e| Error::spool("read", io::Error::other(e)))
    }
}

/// Opens a new file that has lost its name when it is open. Nobody else can open it, so it is not locked.
#[cfg(unix)]
fn open() -> io::Result<Connection> {
    use rusqlite::OpenFlags;

    let path = tempfile::NamedTempFile::new()?.into_temp_path();
    let flags = OpenFlags::SQLITE_OPEN_READ_WRITE | OpenFlags::SQLITE_OPEN_NO_MUTEX;
    let connection = Connection::open_with_flags_and_vfs(&path, flags, c"unix-none").map_err(io::Error::other)?;
    path.close()?;
    Ok(connection)
}

/// Where an open file cannot lose its name, `SQLite` has the system delete it when it is closed. Its folder is the same.
#[cfg(not(unix))]
fn open() -> io::Result<Connection> {
    Connection::open("").map_err(io::Error::other)
}
