{%- if states %}

  u_states : entity pe_lib.pe_state_port
    generic map (
      STATE_BITS   => {{ state_bits }},
      STATE_COUNT  => {{ state_count }},
      STATE_CLOCKS => {{ state_clocks }}
    )
    port map (
      clk_i       => aclk,
      want_i      => port_want,
      new_i       => port_new,
      give_i      => port_give,
      given_i     => port_given,
      forget_i    => renew,
      word_o      => state_word,
      settled_o   => settled,
      granted_o   => port_granted,
      free_o      => port_free,
      replacing_o => port_replacing,
      begins_o    => port_begins,
      ce_i        => ce,
      access_o    => access_wanted,
      access_i    => access_given,
      state_i     => state_read,
      state_o     => state_written,
      valid_o     => state_valid,
      ready_i     => state_taken
    );
{%- if let Some(parameters) = parameters %}

  u_parameters : entity pe_lib.pe_parameters
    generic map (
      WORD_BITS    => ADDRESS_BITS - 4,
      PARAMETERS   => {{ parameters.count }},
      HALVES       => {{ parameters.halves }},
      STATE_BITS   => {{ state_bits }},
      ADDRESS_BITS => {{ state_address_bits }},
      ROWS         => {{ state_count }},
      ORDER        => STORED_WORDS
    )
    port map (
      clk_i       => aclk,
      word_i      => address(ADDRESS_BITS - 3 downto 2),
      write_i     => param_write,
      strobe_i    => strobe,
      data_i      => data,
      parameter_o => param_data,
      is_param_o  => is_param,
      initial_i   => first_parameters,
      take_i      => tune,
      renew_i     => renew,
      tuning_o    => tuning,
      want_o      => tuner_want,
      address_o   => tuner_address,
      new_o       => tuner_new,
      give_o      => tuner_give,
      given_o     => tuner_given,
      state_i     => state_word,
      settled_i   => settled,
      granted_i   => port_granted,
      free_i      => port_free,
      replacing_i => port_replacing
    );

  -- Parameters of the initial state
{%- for word in parameters.initial %}
  first_parameters({{ 32 * loop.index0 + 31 }} downto {{ 32 * loop.index0 }})	<= {{ word.value }};	-- {{ word.comment }}
{%- endfor %}

  -- Parameters have the states to themselves while they are on their way.
  port_want    <= want or tuner_want;
  port_address <= tuner_address when tuning = '1' else
                  state_address;
  port_new     <= state_new or tuner_new;
  port_give    <= state_give or tuner_give;
  port_given   <= tuner_given when tuning = '1' else
                  state_given;
  granted      <= port_granted and not tuning;
  free         <= port_free and not tuning;
  replacing    <= port_replacing and not tuning;
  forget       <= port_begins and not tuning;
{%- else %}

  port_want    <= want;
  port_address <= state_address;
  port_new     <= state_new;
  port_give    <= state_give;
  port_given   <= state_given;
  granted      <= port_granted;
  free         <= port_free;
  replacing    <= port_replacing;
  forget       <= port_begins;
{%- endif %}
{%- else %}

  -- No states for the host
  state_word <= (others => '0');
  settled    <= '1';
  granted    <= '0';
  free       <= '0';
  replacing  <= '0';
  forget     <= '0';
{%- endif %}
{%- if parameters.is_none() %}

  -- No parameters
  param_data <= (others => '0');
  is_param   <= '0';
  tuning     <= '0';
{%- endif %}
