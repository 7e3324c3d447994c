//! The variant of iceoryx2 that a run speaks: its standard one between processes, but for memory in
//! files below the configured root instead of POSIX shared memory, which is in /dev/shm for good.
//! So a run is one directory: it can be anywhere, is closed to others by one mode, and is gone when
//! the directory is.
//!
//! iceoryx2 takes such a variant as a list of its own building blocks. That it may come from outside
//! is not promised for later versions, hence the pinned one.

use std::fmt::Debug;

use iceoryx2::prelude::ZeroCopySend;
use iceoryx2::service::{Service, internal::ServiceInternal, ipc};
use iceoryx2_bb_elementary_traits::testing::abandonable::Abandonable;
use iceoryx2_cal::resizable_shared_memory::dynamic::DynamicMemory;
use iceoryx2_cal::shared_memory::file::Memory;
use iceoryx2_cal::shm_allocator::bump_allocator::BumpAllocator;
use iceoryx2_cal::shm_allocator::pool_allocator::PoolAllocator;
use iceoryx2_cal::{arc_sync_policy, dynamic_storage, zero_copy_connection};

/// Memory in files, between processes, each port used by one thread.
#[derive(Debug, Clone)]
pub struct Ipc {}

impl ServiceInternal<Ipc> for Ipc {}

impl Service for Ipc {
    type PersistentDynamicStorage<T: Debug + Send + Sync + ZeroCopySend + 'static> =
        dynamic_storage::file::Storage<T>;
    type DynamicStorage<T: Debug + Send + Sync + ZeroCopySend + 'static> =
        dynamic_storage::file::Storage<T>;
    type SharedMemory = Memory<PoolAllocator>;
    type ResizableSharedMemory = DynamicMemory<PoolAllocator, Memory<PoolAllocator>>;
    type Connection = zero_copy_connection::file::Connection;
    type BlackboardMgmt<T: Send + Sync + Debug + ZeroCopySend + 'static> =
        dynamic_storage::file::Storage<T>;
    type BlackboardPayload = Memory<BumpAllocator>;

    // As in the standard variant.
    type StaticStorage = <ipc::Service as Service>::StaticStorage;
    type ConfigSerializer = <ipc::Service as Service>::ConfigSerializer;
    type Bag = <ipc::Service as Service>::Bag;
    type ServiceNameHasher = <ipc::Service as Service>::ServiceNameHasher;
    type Event = <ipc::Service as Service>::Event;
    type Monitoring = <ipc::Service as Service>::Monitoring;
    type Reactor = <ipc::Service as Service>::Reactor;
    type ArcThreadSafetyPolicy<T: Send + Debug + Abandonable> =
        arc_sync_policy::single_threaded::SingleThreaded<T>;
    type UniqueId = <ipc::Service as Service>::UniqueId;
}
