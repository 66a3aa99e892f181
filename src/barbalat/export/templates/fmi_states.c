FMI fmi${version}Status fmi${version}Get${state}(${component} c, fmi${version}${state} *state)
{
    *state = copied(&((instance *)c)->state, (fmu_state *)*state);
    return *state != NULL ? fmi${version}OK : refused(c, "there is no memory for a state");
}

FMI fmi${version}Status fmi${version}Set${state}(${component} c, fmi${version}${state} state)
{
    if (state == NULL) {
        return refused(c, "no state is given");
    }
    (void)copied((const fmu_state *)state, &((instance *)c)->state);
    return fmi${version}OK;
}

FMI fmi${version}Status fmi${version}Free${state}(${component} c, fmi${version}${state} *state)
{
    (void)c;
    if (state != NULL) {
        free(*state);
        *state = NULL;
    }
    return fmi${version}OK;
}

FMI fmi${version}Status fmi${version}Serialized${state}Size(${component} c, fmi${version}${state} state, size_t *size)
{
    (void)c;
    (void)state;
    *size = sizeof(fmu_saved);
    return fmi${version}OK;
}

FMI fmi${version}Status fmi${version}Serialize${state}(${component} c, fmi${version}${state} state, fmi${version}Byte bytes[], size_t size)
{
    if (state == NULL || size < sizeof(fmu_saved)) {
        return refused(c, "no state is given, or no room for it");
    }
    to_bytes((const fmu_state *)state, bytes);
    return fmi${version}OK;
}

FMI fmi${version}Status fmi${version}${read}${state}(${component} c, const fmi${version}Byte bytes[], size_t size, fmi${version}${state} *state)
{
    fmu_state read;
    const char *what = from_bytes(bytes, size, &read);
    if (what == NULL) {
        *state = copied(&read, (fmu_state *)*state);
        what = *state != NULL ? NULL : "there is no memory for a state";
    }
    return unless(c, what);
}
