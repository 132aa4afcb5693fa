/* Memory of instances and of saved states: from the master, or, with FMI2_STATIC_INSTANCES, from a pool of so many
 * instances, and nothing is allocated. The pool is no matter of threads: instances from it are made by one of them. */

/* Slots are named by so many bits; generations by the rest. */
enum { SLOT_BITS = 16 };

/* A number that differs from instance to instance. */
static size_t salt_of(const Instance *instance) {
    size_t mixed = (size_t)(uintptr_t)instance / 16 * 2654435761U;
#ifndef FMI2_STATIC_INSTANCES
    /* Another instance may have had this address before. In a pool generations go on. */
    mixed ^= (size_t)clock() * 2246822519U ^ (size_t)time(NULL) * 3266489917U;
#endif
    return mixed >> SLOT_BITS;
}

#ifdef FMI2_STATIC_INSTANCES

static Instance instance_pool[FMI2_STATIC_INSTANCES];

static Instance *make_instance(const fmi2CallbackFunctions *callbacks, const char *name) {
    for (int k = 0; k < FMI2_STATIC_INSTANCES; k++) {
        Instance *instance = &instance_pool[k];
        if (instance->name != NULL) {
            continue;
        }
        instance->callbacks = *callbacks;
        instance->name = instance->name_room;
        strncpy(instance->name, name, FMI2_STATIC_NAME - 1);
        instance->slots = instance->slot_room;
        instance->slot_count = FMI2_STATIC_STATES;
        instance->log.count = instance->log.sent = instance->log.left_out = 0;
        instance->is_freed = 0;
        return instance;
    }
    return NULL;
}

static void forget(Instance *instance, Slot *slot) {
    (void)instance;
    slot->saved = NULL;
}

static void release(Instance *instance) {
    for (size_t k = 0; k < instance->slot_count; k++) {
        forget(instance, &instance->slots[k]);
    }
    instance->name = NULL;
}

static int add_slots(Instance *instance) {
    (void)instance;
    return 0;
}

static Snapshot *snapshot_room(Instance *instance, size_t slot) {
    return &instance->snapshots[slot];
}

#else

/* Memory of zeros, or NULL. */
static void *allocate(const fmi2CallbackFunctions *callbacks, size_t size) {
    int masters = callbacks->allocateMemory != NULL && callbacks->freeMemory != NULL;
    void *memory = masters ? callbacks->allocateMemory(1, size) : malloc(size);
    return memory != NULL ? memset(memory, 0, size) : NULL;
}

static void give_back(const fmi2CallbackFunctions *callbacks, void *memory) {
    int masters = callbacks->allocateMemory != NULL && callbacks->freeMemory != NULL;
    if (memory == NULL) {
        return;
    }
    if (masters) {
        callbacks->freeMemory(memory);
    } else {
        free(memory);
    }
}

static Instance *make_instance(const fmi2CallbackFunctions *callbacks, const char *name) {
    size_t length = strlen(name) + 1;
    Instance *instance = allocate(callbacks, sizeof *instance);
    char *kept = allocate(callbacks, length);
    if (instance == NULL || kept == NULL) {
        give_back(callbacks, instance);
        give_back(callbacks, kept);
        return NULL;
    }
    instance->callbacks = *callbacks;
    instance->name = memcpy(kept, name, length);
    return instance;
}

static void forget(Instance *instance, Slot *slot) {
    give_back(&instance->callbacks, slot->saved);
    slot->saved = NULL;
}

static void release(Instance *instance) {
    fmi2CallbackFunctions callbacks = instance->callbacks;
    for (size_t k = 0; k < instance->slot_count; k++) {
        forget(instance, &instance->slots[k]);
    }
    give_back(&callbacks, instance->slots);
    give_back(&callbacks, instance->name);
    give_back(&callbacks, instance);
}

static int add_slots(Instance *instance) {
    size_t most = ((size_t)1 << SLOT_BITS) - 1, before = instance->slot_count;
    size_t count = before == 0 ? 4 : before < most / 2 ? 2 * before : most;
    Slot *slots = count > before ? allocate(&instance->callbacks, count * sizeof *slots) : NULL;
    if (slots == NULL) {
        return 0;
    }
    if (before > 0) {
        memcpy(slots, instance->slots, before * sizeof *slots);
    }
    give_back(&instance->callbacks, instance->slots);
    instance->slots = slots;
    instance->slot_count = count;
    return 1;
}

static Snapshot *snapshot_room(Instance *instance, size_t slot) {
    (void)slot;
    return allocate(&instance->callbacks, sizeof(Snapshot));
}

#endif
